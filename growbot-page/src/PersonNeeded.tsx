// Banner when a robot needs a person: the cause, what is safe, and the one next step of the guided sequence.

import { useId } from "preact/hooks";
import type { RecoveryStep } from "./api_types";
import { formatTitle } from "./format";
import { GuardedButton } from "./GuardedButton";
import { canControl, isServiceSilent } from "./page_state";
import type { Robot } from "./page_state";
import {
  ACTION_LABELS, doAlternative, doStep, isLeavable, leaveRecovery, pendingSteps, recoveryOf, stepBlockedBy,
} from "./recovery";

interface StepButtonProps {
  robot: Robot;
  step: RecoveryStep;
  isMain?: boolean;
  /** Id of the text that describes the step. */
  describedBy: string;
  onPress(): void;
}

/** Button of a step. Only a stop is pressed by the second click of a double click. */
function StepButton({ robot, step: { action }, isMain, describedBy, onPress }: StepButtonProps) {
  const shared = { class: isMain ? "primary" : undefined, "aria-describedby": describedBy };
  const label = action ? ACTION_LABELS[action] : "Done";
  return action === "stop"
    ? <button type="button" {...shared} onClick={onPress}>{label}</button>
    : <GuardedButton robot={robot.status.name} {...shared} onPress={onPress}>{label}</GuardedButton>;
}

export function PersonNeeded({ robot }: { robot: Robot }) {
  const id = useId();
  const { name } = robot.status;
  const progress = recoveryOf(robot);
  if (!progress) return <div role="alert" class="need-place" />;
  const { sequence: { situation, interrupts, cause, safety, steps, alternative }, done } = progress;
  const step = steps[done];
  const blockedBy = stepBlockedBy(robot, step);
  const isLast = done + 1 === steps.length;
  return (
    <div role="alert" class="need-place">
      <div class={interrupts ? "need urgent" : "need"}>
        <p id={id}>
          <b>{formatTitle(situation)}:</b> {cause.replace(/\.$/, "")}. {safety} <b>Next:</b> {step.text}{" "}
          {canControl.value === true && blockedBy}
        </p>
        {canControl.value === true && !isServiceSilent.value && !pendingSteps.value.has(name) && (
          <div class="row">
            {alternative?.action && !stepBlockedBy(robot, alternative) && (
              <StepButton
                robot={robot} step={alternative} describedBy={id}
                onPress={() => { if (alternative.action) void doAlternative(robot, alternative.action); }}
              />
            )}
            {(step.action || !isLast || progress.procedure) && !blockedBy && (
              <StepButton
                key={done} robot={robot} step={step} describedBy={id} isMain
                onPress={() => void doStep(robot, progress)}
              />
            )}
            {isLeavable(progress) && <button type="button" onClick={() => leaveRecovery(name, progress)}>Leave</button>}
          </div>
        )}
      </div>
    </div>
  );
}
