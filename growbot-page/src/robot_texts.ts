// Texts about the state of a robot.

import type { RobotStatus } from "./api_types";
import { formatDuration } from "./format";
import { ageMs, canControl, isServiceSilent, isStale } from "./page_state";
import type { Robot } from "./page_state";

/** Returns the state of a robot. A state that is not current is marked. */
export function stateText(robot: Robot): string {
  const { connection, state } = robot.status;
  const text = connection === "disconnected" ? "not connected" : state ?? "unknown";
  return isStale(robot) && state ? `last known: ${text}` : text;
}

/** Returns how old the status of a robot is. Empty if it is current. */
export function ageText(robot: Robot): string {
  if (!isStale(robot)) return "";
  const age = ageMs(robot);
  const old = age === null ? "No report yet" : `${formatDuration(age / 1000)} old`;
  return `${old}: the ${isServiceSilent.value ? "service" : "board"} does not respond`;
}

/** Returns the text about the robot's port and simulation. */
export function portText({ port, simulated, pace, robot }: RobotStatus): string {
  const kind = robot ? `${robot}, ${port}` : port;
  if (!simulated) return kind;
  return `${kind}, simulated${pace && pace !== 1 ? `, ${pace} times as fast as real time` : ""}`;
}

export function temperatureText({ state, temperature_c: celsius, target_c: target }: RobotStatus): string | null {
  if (!state) return null;
  const reading = celsius === null ? "no reading" : celsius.toFixed(1);
  if (target === null) return `${reading}${celsius === null ? "" : " °C"}, heater off`;
  return `${reading} / ${target.toFixed(0)} °C`;
}

/** Returns the reason why no body can grow now, empty if one can. */
export function growthBlockedBy(robot: Robot): string {
  const { status } = robot;
  if (canControl.value === false) return "This URL is read-only: open the control URL to grow.";
  if (status.connection === "disconnected") return "The robot is not connected.";
  if (isStale(robot)) return "The state of the robot is not known.";
  if (status.job) return "A body grows now. The next one can be previewed and queued already.";
  if (status.fault || status.state === "emergency-stop") return "The robot is latched off: press Clear fault first.";
  if (status.state === "tuning") return "The heater is being tuned: wait for its end, or press Stop.";
  return "";
}

/** Returns the reason why maintenance is not possible now, empty if it is possible. */
export function maintenanceBlockedBy(robot: Robot): string {
  const { status } = robot;
  if (!canControl.value) return "This URL is read-only.";
  if (status.connection === "disconnected") return "The robot is not connected.";
  if (isStale(robot)) return "The state of the robot is not known.";
  if (status.state === "paused" && status.job) return "";
  if (status.state === "tuning") return "The heater is being tuned: wait for its end, or press Stop.";
  if (status.state === "parked") return "The robot is parked: press Continue, or Stop and then load filament.";
  if (status.job) return "A body grows: press Pause to change the filament, or Stop.";
  if (status.fault) return "A fault is latched: press Clear fault first.";
  if (status.state === "emergency-stop") return "The emergency stop is latched: press Clear fault first.";
  return "";
}

/** Returns what the commands do that are possible now, or why there are none. */
export function commandHint(robot: Robot): string {
  const { status } = robot;
  if (canControl.value === false) return "This URL is read-only: open the control URL to give commands.";
  if (status.connection === "disconnected") {
    return "The robot is not connected: check its cable and power. A stop is sent as soon as it is connected.";
  }
  if (isStale(robot)) return "The state is not current, so only Pause and Stop can be ordered.";
  if (status.fault || status.state === "emergency-stop") {
    return "Heater and motors are off. Clearing heats nothing: the robot heats only when you press Resume or Grow.";
  }
  switch (status.state) {
    case "paused":
      return "Continue goes on with the next layer. Stop switches heater and motors off; the body can be resumed.";
    case "parked":
      return "The heater is off after a long pause. Continue heats and homes first.";
    default:
      return status.job
        ? "Pause finishes the layer and keeps the nozzle warm. Stop switches heater and motors off; the body can be "
          + "resumed."
        : "No body grows, so there is nothing to pause. Stop switches heater and motors off.";
  }
}
