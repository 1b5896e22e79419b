// The state of a robot, what an operator wants to know first, its commands, and maintenance.

import { Commands } from "./Commands";
import { Maintenance } from "./Maintenance";
import type { Robot } from "./page_state";
import { jobs } from "./page_state";
import { Progress } from "./Progress";
import { portText, temperatureText } from "./robot_texts";
import type { BodyMessage } from "./viewer_messages";

interface StateCardProps {
  robot: Robot;
  /** The active body, as the 3D view shows it. Null if there is none. */
  body: BodyMessage | null;
}

/** Returns the names and values that the card lists. */
function facts({ status }: Robot, body: BodyMessage | null): [string, string][] {
  const job = jobs.value?.find(({ id }) => id === status.job);
  const list: [string, string][] = [];
  const add = (name: string, value: string | null | undefined | false) => { if (value) list.push([name, value]); };
  add("Nozzle", temperatureText(status));
  add("Job", job?.name ?? status.job);
  if (body) {
    add("Body", `${body.lengthMm.toFixed(1)} of ${body.plannedMm.toFixed(1)} mm`);
    if (body.latestDeviationMm !== null && body.maxDeviationMm !== null) {
      add("Off the plan", `${body.latestDeviationMm.toFixed(2)} mm (max ${body.maxDeviationMm.toFixed(2)})`);
    }
  } else if (job) add("Body", `${job.length_mm.toFixed(1)} mm planned`);
  add("Pause reason", status.pause_explanation);
  return list;
}

export function StateCard({ robot, body }: StateCardProps) {
  const { status } = robot;
  return (
    <section class="card robot" aria-label={`Robot ${status.name}`}>
      <h2>{status.name} <span class="about">· {portText(status)}</span></h2>
      <Progress robot={robot} />
      <dl>
        {facts(robot, body).map(([name, value]) => <div key={name}><dt>{name}</dt><dd>{value}</dd></div>)}
      </dl>
      <Commands robot={robot} />
      <Maintenance robot={robot} />
    </section>
  );
}
