// Cost, clearance and warnings of a planned body.

import type { Plan, RobotStatus } from "./api_types";
import { formatDuration, formatTime, formatTitle } from "./format";

export function PlanSummary({ plan, robot }: { plan: Plan; robot: RobotStatus }) {
  const { length_mm: length, layers, duration_s: duration, filament_mm: filament, warnings, scene } = plan;
  const finish = robot.pace ? `, done at ${formatTime(Date.now() + (1000 * duration) / robot.pace)}` : "";
  const margin = scene?.margin_mm === undefined ? "" : `, margin ${scene.margin_mm.toFixed(1)}`;
  const facts: [string, string][] = [
    ["Length", `${length.toFixed(1)} mm, ${layers} layers`],
    ["Time", `${formatDuration(duration)}${finish}`],
    ["Filament", `${(filament / 1000).toFixed(2)} m`],
    ["Clearance", scene ? `${scene.clearance_mm.toFixed(1)} mm${margin}` : "not checked: no scene"],
  ];
  return (
    <div role="status" aria-label="Preview">
      <dl>{facts.map(([name, value]) => <div key={name}><dt>{name}</dt><dd>{value}</dd></div>)}</dl>
      {warnings.map(({ code, message }) => <p key={code} class="warn"><b>{formatTitle(code)}.</b> {message}</p>)}
    </div>
  );
}
