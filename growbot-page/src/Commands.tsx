// The commands of a robot: pause, continue and stop at fixed places, and below them those that its state offers.

import type { CommandName } from "./api_types";
import { GuardedButton } from "./GuardedButton";
import { canControl, messages } from "./page_state";
import type { Robot } from "./page_state";
import { allowedCommands, giveCommand, resumableJob, resume } from "./robot_commands";
import { commandHint } from "./robot_texts";

const FIXED: [CommandName & ("pause" | "continue" | "stop"), string][] =
  [["pause", "Pause"], ["continue", "Continue"], ["stop", "Stop"]];

export function Commands({ robot }: { robot: Robot }) {
  const { name } = robot.status;
  const allowed = allowedCommands(robot);
  const isControl = canControl.value === true;
  const job = resumableJob(robot);
  const hint = `hint-${name}`;
  const message = messages.value.get(name);
  return (
    <>
      <div class="row" role="group" aria-label="Commands">
        {FIXED.map(([command, label]) => {
          const shared = { "aria-describedby": hint, disabled: !isControl || !allowed[command] };
          const press = () => void giveCommand(name, command);
          // A stop or a pause counts however soon it follows another click.
          return command === "continue"
            ? <GuardedButton key={command} robot={name} {...shared} onPress={press}>{label}</GuardedButton>
            : <button key={command} type="button" {...shared} onClick={press}>{label}</button>;
        })}
      </div>
      {isControl && (job || allowed.cancel || allowed["withdraw-stop"]) && (
        <div class="row" role="group" aria-label="Body">
          {job && <GuardedButton robot={name} class="primary" onPress={() => void resume(job)}>Resume</GuardedButton>}
          {allowed.cancel && (
            <button type="button" onClick={() => void giveCommand(name, "cancel")}>Discard body</button>
          )}
          {allowed["withdraw-stop"] && (
            <button type="button" onClick={() => void giveCommand(name, "withdraw-stop")}>Withdraw stop</button>
          )}
        </div>
      )}
      <p class={message?.isError ? "message error" : "message"} role="status" aria-label="Result of the command">
        {message?.text ?? ""}
      </p>
      <p class="hint" id={hint}>
        {commandHint(robot)}{job && " Resume heats, homes and goes on with the body that the board keeps."}
      </p>
    </>
  );
}
