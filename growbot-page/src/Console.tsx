// The console of a robot: typed commands, for those who prefer them to buttons.

import { useEffect, useId, useRef, useState } from "preact/hooks";
import { complete, runLine } from "./console_commands";
import type { ConsoleResponse } from "./console_commands";

const MAX_ENTRIES = 100;

interface ConsoleEntry extends ConsoleResponse {
  id: number;
  line: string;
}

export function Console({ robotName }: { robotName: string }) {
  const [entries, setEntries] = useState<ConsoleEntry[]>([]);
  const [line, setLine] = useState("");
  // Number of lines back from the present one, from 0.
  const [back, setBack] = useState(0);
  const hint = useId();
  const latest = useRef(0);
  const log = useRef<HTMLDivElement>(null);
  useEffect(() => { log.current?.scrollTo(0, log.current.scrollHeight); }, [entries]);
  const lines = entries.map((entry) => entry.line);
  const run = async () => {
    const typed = line.trim();
    if (!typed) return;
    setLine("");
    setBack(0);
    latest.current += 1;
    const id = latest.current;
    const waiting: ConsoleEntry = { id, line: typed, text: "no response yet", isError: false };
    setEntries((before) => [...before, waiting].slice(-MAX_ENTRIES));
    const response = await runLine(robotName, typed);
    setEntries((before) => before.map((entry) => (entry.id === id ? { ...entry, ...response } : entry)));
  };
  const recall = (to: number) => {
    if (to < 0 || to > lines.length) return;
    setBack(to);
    setLine(to === 0 ? "" : lines[lines.length - to]);
  };
  const press = (event: KeyboardEvent) => {
    if (event.key === "ArrowUp" || event.key === "ArrowDown") {
      event.preventDefault();
      recall(back + (event.key === "ArrowUp" ? 1 : -1));
    }
    if (event.key !== "Tab" || event.shiftKey || !line.trim()) return;
    // Without something to complete, Tab leaves the field.
    const completed = commonStart(complete(line));
    if (completed.length <= line.trim().length) return;
    event.preventDefault();
    setLine(completed);
  };
  return (
    <details class="card console">
      <summary>Console</summary>
      <div ref={log} class="console-log" role="log" aria-label="Responses of the console" tabIndex={0}>
        {entries.map((entry) => (
          <div key={entry.id}>
            <p class="typed">&gt; {entry.line}</p>
            <p class={entry.isError ? "error" : ""}>{entry.text}</p>
          </div>
        ))}
      </div>
      <form onSubmit={(event) => { event.preventDefault(); void run(); }}>
        <label>Command
          <input
            value={line} autocomplete="off" autocapitalize="off" spellcheck={false} aria-describedby={hint}
            onKeyDown={press} onInput={({ currentTarget }) => { setBack(0); setLine(currentTarget.value); }}
          />
        </label>
        <button type="submit">Run</button>
      </form>
      <p class="hint" id={hint}>`help` lists the commands. Tab completes, and the arrow keys repeat.</p>
    </details>
  );
}

/** Returns the longest text with which all of these begin. Empty without any. */
function commonStart(texts: string[]): string {
  if (texts.length === 0) return "";
  let length = texts[0].length;
  for (const text of texts) while (!text.startsWith(texts[0].slice(0, length))) length -= 1;
  return texts[0].slice(0, length);
}
