// All robots: a grid of cards.

import { Commands } from "./Commands";
import { fragmentOf, robots } from "./page_state";
import type { Robot } from "./page_state";
import { PersonNeeded } from "./PersonNeeded";
import { Progress } from "./Progress";
import { portText, temperatureText } from "./robot_texts";

function RobotCard({ robot }: { robot: Robot }) {
  const { status } = robot;
  const temperature = temperatureText(status);
  return (
    <section class="card robot" aria-label={`Robot ${status.name}`}>
      <h2><a href={fragmentOf(status.name)}>{status.name}</a> <span class="about">· {portText(status)}</span></h2>
      <PersonNeeded robot={robot} />
      <Progress robot={robot} />
      {temperature && <dl><div><dt>Nozzle</dt><dd>{temperature}</dd></div></dl>}
      <Commands robot={robot} />
    </section>
  );
}

export function Overview() {
  const all = [...robots.value.values()];
  return (
    <div class="overview">
      {all.map((robot) => <RobotCard key={robot.status.name} robot={robot} />)}
      {all.length === 0 && <p class="card">No robot yet. If this stays, check the service's growbot.toml.</p>}
    </div>
  );
}
