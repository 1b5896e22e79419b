// Numbers as text on the page.

/** Formats a number with this many decimals, without a minus before zeros. */
export function fixed(value, decimals) {
  return (Math.abs(value) < 0.5 * 10 ** -decimals ? 0 : value).toFixed(decimals);
}

/** Formats a duration in its two largest relevant units, like `duration_text` of growbot-pictures/src/duration.rs. */
export function durationText(seconds) {
  if (seconds < 0.995) return `${seconds.toFixed(2)} s`;
  if (seconds < 59.95) return `${seconds.toFixed(1)} s`;
  const rounded = Math.round(seconds);
  if (rounded < 3600) return `${Math.floor(rounded / 60)} min ${rounded % 60} s`;
  const minutes = Math.round(seconds / 60);
  return `${Math.floor(minutes / 60)} h ${minutes % 60} min`;
}

/**
 * Returns the time of day `seconds` after `now` (a Date), like `clock_text` of growbot-pictures/src/clock_text.rs. The day
 * is included if it is another one.
 */
export function finishText(now, seconds) {
  // Rounds to the nearest minute, as durations are rounded.
  const finish = new Date(now.getTime() + 1000 * (seconds + 30));
  const two = (number) => String(number).padStart(2, "0");
  const clock = `${two(finish.getHours())}:${two(finish.getMinutes())}`;
  const day = (date) => Date.UTC(date.getFullYear(), date.getMonth(), date.getDate()) / 86_400_000;
  const days = day(finish) - day(now);
  if (days === 0) return clock;
  if (days === 1) return `tomorrow ${clock}`;
  return `${finish.getFullYear()}-${two(finish.getMonth() + 1)}-${two(finish.getDate())} ${clock}`;
}

/** Returns the largest of 1, 2 and 5 times a power of ten that is at most `max`. */
export function scaleLength(max) {
  const power = 10 ** Math.floor(Math.log10(max));
  const times = [5, 2, 1].find((factor) => factor * power <= max) ?? 1;
  return Number((times * power).toPrecision(1));
}

/** Fills a list with names and values. */
export function fillRows(list, rows) {
  list.replaceChildren(
    ...rows.flatMap(([name, value]) => {
      const [dt, dd] = ["dt", "dd"].map((tag) => document.createElement(tag));
      [dt.textContent, dd.textContent] = [name, value];
      return [dt, dd];
    }),
  );
}

/** Fills lists under headings: `[heading, [[name, value], ...]]` each. */
export function fillNumbers(container, groups) {
  for (const [heading, rows] of groups) {
    const title = document.createElement("h2");
    title.textContent = heading;
    const list = document.createElement("dl");
    fillRows(list, rows);
    container.append(title, list);
  }
}

/** Writes a line for each warning. */
export function fillWarnings(container, warnings) {
  container.replaceChildren(
    ...warnings.map((warning) => {
      const line = document.createElement("p");
      line.className = "warning";
      line.textContent = warning;
      return line;
    }),
  );
}

/**
 * Fills a table with names and the values of two bodies, under these heads and headings: `[heading, [[name, value,
 * value], ...]]` each. Equal values are written once.
 */
export function fillTable(table, heads, groups) {
  const cell = (tag, text, attributes = {}) =>
    Object.assign(document.createElement(tag), { textContent: text, ...attributes });
  const row = (...cells) => {
    const line = document.createElement("tr");
    line.append(...cells);
    return line;
  };
  table.replaceChildren(row(cell("td", ""), ...heads.map((head) => cell("th", head, { scope: "col" }))));
  for (const [heading, rows] of groups) {
    if (heading) table.append(row(cell("th", heading, { colSpan: 3, className: "heading", scope: "colgroup" })));
    for (const [name, one, other] of rows) {
      const values = one === other
        ? [cell("td", one, { colSpan: 2 })]
        : [cell("td", one ?? "–"), cell("td", other ?? "–")];
      table.append(row(cell("th", name, { scope: "row" }), ...values));
    }
  }
}
