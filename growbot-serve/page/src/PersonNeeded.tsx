// Banner when a robot needs a person: the cause, what is safe, and the one next step.

import { formatTitle } from "./format";
import { canControl, isStale } from "./page_state";
import type { Robot } from "./page_state";
import { giveCommand } from "./robot_commands";

interface Need {
  title: string;
  cause: string;
  safe: string;
  /** The one next step. */
  step: string;
  /** True if the step is to clear the fault. */
  clears?: boolean;
}

/** Returns why a robot needs a person. Null if it does not. */
function needOf(robot: Robot): Need | null {
  const { status } = robot;
  if (status.connection === "disconnected" || isStale(robot)) return null;
  const layers = `${status.laid} of ${status.layers} layers`;
  const kept = status.layers > status.laid && status.laid > 0
    ? `Heater and motors are off, and the board keeps ${layers}.` : "Heater and motors are off.";
  const clears = !status.job;
  if (status.fault) {
    return {
      title: `Fault: ${formatTitle(status.fault).toLowerCase()}.`, cause: `${status.fault_explanation}.`, safe: kept,
      step: "After that, press Clear fault.", clears,
    };
  }
  if (status.state === "emergency-stop") {
    return {
      title: "Emergency stop.", cause: "The robot stays off until the stop is cleared.", safe: kept,
      step: "When it is safe, press Clear fault.", clears,
    };
  }
  if (status.pause_cause === "filament-out" && status.state === "paused") {
    return {
      title: "Out of filament.", cause: `${status.pause_explanation}.`,
      safe: "The robot waits after a whole layer, with a warm nozzle.",
      step: "Under Maintenance, unload and load filament, then press Continue.",
    };
  }
  if (status.state === "parked" && status.job) {
    const step = status.pause_cause === "filament-out"
      ? "Press Stop, load filament under Maintenance, and press Resume."
      : "Press Continue: the robot heats and homes first.";
    return { title: "Parked.", cause: "The pause was long.", safe: kept, step };
  }
  return null;
}

export function PersonNeeded({ robot }: { robot: Robot }) {
  const need = needOf(robot);
  const { name } = robot.status;
  return (
    <div role="alert" class="need-place">
      {need && (
        <div class="need">
          <p><b>{need.title}</b> {need.cause} {need.safe} {need.step}</p>
          {need.clears && canControl.value !== false && (
            <button type="button" class="primary" onClick={() => void giveCommand(name, "clear-fault")}>
              Clear fault
            </button>
          )}
        </div>
      )}
    </div>
  );
}
