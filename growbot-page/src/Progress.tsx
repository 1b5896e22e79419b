// State of a robot and progress of its body.

import { formatClock, formatDuration } from "./format";
import { isStale } from "./page_state";
import type { Robot } from "./page_state";
import { ageText, stateText } from "./robot_texts";

export function Progress({ robot }: { robot: Robot }) {
  const { status } = robot;
  const { layers, laid, left_s: left, finish_utc: finish } = status;
  const state = isStale(robot) ? "stale" : status.fault ? "fault" : status.state ?? "";
  return (
    <div class={isStale(robot) ? "progress stale" : "progress"}>
      <p class="state" role="status" aria-label="State" data-state={state}>{stateText(robot)}</p>
      <p class="age" role="status" aria-label="Age of the state">{ageText(robot)}</p>
      <div role="alert">{status.command_error && <p class="alarm">{status.command_error}</p>}</div>
      {layers > 0 && (
        <>
          <progress max={layers} value={laid} aria-label="Layers laid" />
          <p class="layers">
            <span>Layer {laid} of {layers}</span>
            {left !== null && <span>{formatDuration(left)} left{finish && `, at ${formatClock(finish)}`}</span>}
          </p>
        </>
      )}
    </div>
  );
}
