// A chart of one quantity over time or length, with its text equivalent.

import { useEffect, useRef, useState } from "preact/hooks";
import uPlot from "uplot";

export interface Line {
  name: string;
  values: (number | null)[];
  /** Name of the CSS property with the colour. */
  colour: string;
  dashed?: boolean;
}

export interface ChartProps {
  title: string;
  /** The present value. */
  value: string;
  /** Text that stands for the picture of the chart. */
  summary: string;
  /** Unit of the horizontal axis. */
  unit: string;
  x: number[];
  lines: Line[];
  /** Smallest range of the vertical axis, so that noise does not look like a change. */
  minRange: number;
  /** Position of the 3D view's slider on the horizontal axis. Null if it is not shown. */
  cursor?: number | null;
  /** Called with the position that a person points at and presses. */
  onPick?(x: number): void;
}

const HEIGHT = 120;
const FONT = "11px system-ui, sans-serif";

/** Returns a number that changes when the colours of the page change. */
function useTheme(): number {
  const [theme, setTheme] = useState(0);
  useEffect(() => {
    const queries = ["(prefers-color-scheme: dark)", "(prefers-contrast: more)"].map((query) => matchMedia(query));
    const change = () => setTheme((before) => before + 1);
    for (const query of queries) query.addEventListener("change", change);
    return () => { for (const query of queries) query.removeEventListener("change", change); };
  }, []);
  return theme;
}

/** Returns a colour of the page for the canvas in this element. A canvas knows neither properties nor `light-dark`. */
function colourOf(element: HTMLElement, name: string): string {
  element.style.color = `var(${name})`;
  const { color } = getComputedStyle(element);
  element.style.color = "";
  return color;
}

/** Returns the range of the vertical axis for values in this range. */
function rangeOf(min: number, max: number, minRange: number): [number, number] {
  const margin = Math.max((minRange - (max - min)) / 2, 0.08 * (max - min));
  return [min - margin, max + margin];
}

/** Draws the position of the slider. */
function drawCursor(plot: uPlot, at: number | null | undefined): void {
  if (at === null || at === undefined) return;
  const x = Math.round(plot.valToPos(at, "x", true));
  const { left, top, width, height } = plot.bbox;
  if (x < left || x > left + width) return;
  plot.ctx.fillStyle = colourOf(plot.root, "--ink");
  plot.ctx.fillRect(x, top, devicePixelRatio, height);
}

export function Chart(props: ChartProps) {
  const { title, value, summary, unit, x, lines, cursor } = props;
  const host = useRef<HTMLDivElement>(null);
  const plot = useRef<uPlot | undefined>(undefined);
  const latest = useRef(props);
  latest.current = props;
  const theme = useTheme();
  const names = lines.map(({ name }) => name).join();
  const isEmpty = x.length < 2;
  useEffect(() => {
    const element = host.current;
    if (!element || isEmpty) return undefined;
    const axis = {
      stroke: colourOf(element, "--muted"), font: FONT, ticks: { show: false },
      grid: { stroke: colourOf(element, "--line"), width: 1 },
    };
    const pick = (self: uPlot) => () => {
      if (self.cursor.left !== undefined && self.cursor.left >= 0) {
        latest.current.onPick?.(self.posToVal(self.cursor.left, "x"));
      }
    };
    const made = new uPlot({
      width: element.clientWidth, height: HEIGHT, legend: { show: false },
      scales: { x: { time: false }, y: { range: (_, min, max) => rangeOf(min, max, latest.current.minRange) } },
      axes: [
        { ...axis, size: 22, gap: 2, space: 60, values: (_, ticks) => ticks.map((tick) => `${tick} ${unit}`) },
        { ...axis, size: 44, gap: 4, space: 28 },
      ],
      series: [{}, ...latest.current.lines.map(({ name, colour, dashed }) => ({
        label: name, stroke: colourOf(element, colour), width: 1.6, points: { show: false },
        dash: dashed ? [4, 4] : undefined,
      }))],
      cursor: { y: false, drag: { x: false, y: false }, points: { show: false } },
      hooks: {
        draw: [(self) => drawCursor(self, latest.current.cursor)],
        ready: [(self) => self.over.addEventListener("click", pick(self))],
      },
    }, [x, ...lines.map(({ values }) => values)] as uPlot.AlignedData, element);
    plot.current = made;
    const observer = new ResizeObserver(() => made.setSize({ width: element.clientWidth, height: HEIGHT }));
    observer.observe(element);
    return () => {
      observer.disconnect();
      made.destroy();
      plot.current = undefined;
    };
  }, [theme, names, unit, isEmpty]);
  useEffect(() => plot.current?.setData([x, ...lines.map(({ values }) => values)] as uPlot.AlignedData), [x, lines]);
  useEffect(() => plot.current?.redraw(), [cursor]);
  return (
    <figure>
      <figcaption><span>{title}</span><span>{value}</span></figcaption>
      <div ref={host} class="plot" role="img" aria-label={summary}>{isEmpty && <p>No data yet</p>}</div>
    </figure>
  );
}
