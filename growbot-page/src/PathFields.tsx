// The path of the next body: waypoints, and the goal.

import { useRef } from "preact/hooks";
import type { RobotStatus } from "./api_types";
import { EMPTY_WAYPOINT } from "./goal";
import type { Target } from "./goal";
import { GoalFields } from "./GoalFields";
import { continuableJob } from "./job_list";
import { enter } from "./next_body";
import type { NextBodyForm } from "./next_body";

/** Maximum number of waypoints that the service takes. */
const MAX_WAYPOINTS = 100;

export function PathFields({ status, form }: { status: RobotStatus; form: NextBodyForm }) {
  const { target, waypoints, problem, continued } = form;
  const robot = status.name;
  const last = continuableJob(status);
  const chosen = continued ?? last?.id;
  const list = useRef<HTMLDivElement>(null);
  const change = (index: number, changed: Target[]) =>
    enter(robot, { waypoints: [...waypoints.slice(0, index), ...changed, ...waypoints.slice(index + 1)] });
  /** Moves the focus once the page is drawn, because the focused element may be gone. */
  const focus = (selector: string) =>
    requestAnimationFrame(() => list.current?.querySelector<HTMLElement>(selector)?.focus());
  const problemOf = (number: number | undefined) =>
    problem && problem.field !== "scene" && problem.waypoint === number ? problem : null;
  return (
    <div class="path" ref={list}>
      {chosen && (
        <label class="check">
          <input
            type="checkbox" checked={continued !== null}
            onChange={({ currentTarget }) => enter(robot, { continued: currentTarget.checked ? chosen : null })}
          />
          {chosen === last?.id
            ? `Start at the tip of the last body, ${last.name}`
            : "Start at the tip of a body that the board does not have any more: clear this box"}
        </label>
      )}
      {waypoints.map((waypoint, index) => (
        <fieldset key={index} class="waypoint">
          <legend>Waypoint {index + 1}</legend>
          <GoalFields
            label={`Waypoint ${index + 1}`} target={waypoint} problem={problemOf(index + 1)}
            onChange={(changed) => change(index, [changed])}
          />
          <button
            type="button" aria-label={`Remove waypoint ${index + 1}`}
            onClick={() => { change(index, []); focus(".add"); }}
          >
            Remove
          </button>
        </fieldset>
      ))}
      <button
        type="button" class="add" disabled={waypoints.length >= MAX_WAYPOINTS}
        onClick={() => { change(waypoints.length, [EMPTY_WAYPOINT]); focus("fieldset:last-of-type input"); }}
      >
        Add waypoint
      </button>
      <GoalFields
        label="Goal" target={target} problem={problemOf(undefined)}
        onChange={(changed) => enter(robot, { target: changed })}
      />
    </div>
  );
}
