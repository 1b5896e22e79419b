// Maintenance of a robot: a task is chosen first, and then run.

import { useId, useState } from "preact/hooks";
import { GuardedButton } from "./GuardedButton";
import { TASKS } from "./maintenance_tasks";
import type { Robot } from "./page_state";
import { runTask } from "./robot_commands";
import { maintenanceBlockedBy } from "./robot_texts";

export function Maintenance({ robot }: { robot: Robot }) {
  const { status } = robot;
  const [chosen, setChosen] = useState<string | null>(null);
  const [value, setValue] = useState("");
  const [reason, effect] = [useId(), useId()];
  const blockedBy = maintenanceBlockedBy(robot);
  const tasks = TASKS.filter(({ inPause }) => inPause || !status.job);
  const task = tasks.find(({ name }) => name === chosen);
  const hasValue = task?.value !== undefined && !status.job;
  const choose = (name: string) => {
    setChosen(name === chosen ? null : name);
    setValue("");
  };
  const shared = { class: "primary", "aria-describedby": effect };
  const start = () => { if (task) void runTask(status, task.name, hasValue ? value.trim() : ""); };
  const label = task && `Run ${task.label.toLowerCase()}`;
  return (
    <section class="maintenance" aria-label="Maintenance">
      <h3>Maintenance</h3>
      <div class="row tasks">
        {tasks.map(({ name, label }) => (
          <button
            key={name} type="button" aria-pressed={name === chosen} disabled={Boolean(blockedBy)}
            aria-describedby={blockedBy ? reason : undefined} onClick={() => choose(name)}
          >
            {label}
          </button>
        ))}
      </div>
      {blockedBy && <p class="note" id={reason}>{blockedBy}</p>}
      {task && !blockedBy && (
        <form class="task" aria-label={task.label} onSubmit={(event) => event.preventDefault()}>
          {hasValue && (
            <label>{task.value}
              <input
                value={value} autocomplete="off" spellcheck={false}
                onInput={({ currentTarget }) => setValue(currentTarget.value)}
              />
            </label>
          )}
          <p class="note" id={effect}>{task.effect}</p>
          {task.name === "cooldown"
            ? <button type="button" {...shared} onClick={start}>{label}</button>
            : <GuardedButton robot={status.name} {...shared} onPress={start}>{label}</GuardedButton>}
        </form>
      )}
    </section>
  );
}
