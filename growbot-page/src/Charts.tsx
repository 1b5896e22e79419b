// The charts of a body: temperature of the nozzle, deviation from the plan, and height of the layers.

import type { RefObject } from "preact";
import { useMemo } from "preact/hooks";
import { Chart } from "./Chart";
import type { ChartProps } from "./Chart";
import { formatDuration } from "./format";
import { readingsOf } from "./temperature_history";
import { robots } from "./page_state";
import { moveCursor } from "./viewer_messages";
import type { BodyMessage, Reading, ViewedBody } from "./viewer_messages";

/** Returns the text that stands for a chart of a quantity along the body. */
function alongText(name: string, values: number[], lengths: number[]): string {
  if (values.length < 2) return `${name}: no data yet`;
  const [min, max] = [Math.min(...values), Math.max(...values)];
  return `${name} over ${lengths.at(-1)?.toFixed(0)} mm of the body: ${min.toFixed(2)} to ${max.toFixed(2)} mm, `
    + `latest ${values.at(-1)?.toFixed(2)} mm.`;
}

function temperatureChart(readings: Reading[]): ChartProps {
  const first = readings[0]?.[0] ?? 0;
  const [, celsius, target] = readings.at(-1) ?? [0, null, null];
  const temperatures = readings.map(([, reading]) => reading);
  const span = (readings.at(-1)?.[0] ?? 0) - first;
  const [divisor, unit] = span > 7200 ? [3600, "h"] : [60, "min"];
  const goal = target === null ? "heater off" : `target ${target.toFixed(0)} °C`;
  return {
    title: "Nozzle, °C", unit, minRange: 10, value: celsius === null ? "" : `${celsius.toFixed(1)}, ${goal}`,
    summary: celsius === null ? "Temperature of the nozzle: no data yet"
      : `Temperature of the nozzle over ${formatDuration(span)}: ${Math.min(...temperatures).toFixed(0)} to `
        + `${Math.max(...temperatures).toFixed(0)} °C, now ${celsius.toFixed(1)} °C, ${goal}.`,
    x: readings.map(([time]) => (time - first) / divisor),
    lines: [
      { name: "temperature", values: temperatures, colour: "--stop" },
      { name: "target", values: readings.map(([, , wanted]) => wanted), colour: "--muted", dashed: true },
    ],
  };
}

function deviationChart(body: BodyMessage | null): ChartProps {
  const values = body?.deviations ?? [];
  const lengths = body?.deviations ? body.lengths : [];
  return {
    title: "Off the plan, mm", unit: "mm", minRange: 0.02, value: body?.latestDeviationMm?.toFixed(2) ?? "",
    summary: alongText("Deviation from the plan", values, lengths), x: lengths,
    lines: [{ name: "deviation", values, colour: "--accent" }],
  };
}

function heightChart(body: BodyMessage | null): ChartProps {
  const heights = body?.heights ?? [];
  return {
    title: "Layer height, mm", unit: "mm", minRange: 0.02, value: heights.at(-1)?.toFixed(3) ?? "",
    summary: alongText("Layer height", heights, body?.lengths ?? []), x: body?.lengths ?? [],
    lines: [{ name: "height", values: heights, colour: "--ok" }],
  };
}

interface ChartsProps {
  robotName: string;
  viewed: ViewedBody;
  frame: RefObject<HTMLIFrameElement | null>;
}

export function Charts({ robotName, viewed, frame }: ChartsProps) {
  const { body, cursor, readings } = viewed;
  const status = robots.value.get(robotName)?.status;
  const shown = readings?.length ? readings : readingsOf(robotName);
  const nozzle = useMemo(() => temperatureChart(shown), [shown, status]);
  const deviation = useMemo(() => deviationChart(body), [body]);
  const height = useMemo(() => heightChart(body), [body]);
  const shared = {
    cursor: cursor?.lengthMm ?? null,
    onPick: (lengthMm: number) => moveCursor(frame.current, lengthMm),
  };
  return (
    <section class="card charts" aria-label="Charts">
      <Chart {...nozzle} />
      <Chart {...deviation} {...shared} />
      <Chart {...height} {...shared} />
    </section>
  );
}
