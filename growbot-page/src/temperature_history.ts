// The latest temperatures of each robot's nozzle, as the page has received them. The chart shows them when no body
// grows.

import type { RobotStatus } from "./api_types";
import type { Reading } from "./viewer_messages";

const MAX_READINGS = 600;
const readings = new Map<string, Reading[]>();

/** Records the temperatures of these statuses. The oldest are dropped. */
export function addReadings(statuses: RobotStatus[]): void {
  for (const { name, temperature_c: celsius, target_c: target } of statuses) {
    if (celsius === null) continue;
    const before = readings.get(name) ?? [];
    readings.set(name, [...before, [performance.now() / 1000, celsius, target] as Reading].slice(-MAX_READINGS));
  }
}

export const readingsOf = (name: string): Reading[] => readings.get(name) ?? [];
