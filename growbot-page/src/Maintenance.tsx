// Maintenance of a robot: a task is chosen first, and then run.

import { useId, useState } from "preact/hooks";
import type { TuningReport } from "./api_types";
import { GuardedButton } from "./GuardedButton";
import { TASKS } from "./maintenance_tasks";
import type { Robot } from "./page_state";
import { beginProcedure, PROCEDURES } from "./recovery";
import { runTask } from "./robot_commands";
import { maintenanceBlockedBy } from "./robot_texts";

/** Gains of the heater that the latest tuning has found. */
function TunedGains({ tuning: { kp, ki, kd, simulated } }: { tuning: TuningReport }) {
  const gains: [string, string][] = [["kp", kp.toFixed(5)], ["ki", ki.toFixed(6)], ["kd", kd.toFixed(4)]];
  return (
    <div role="status" aria-label="Gains of the heater">
      <p class="note">
        Gains for <code>[heater]</code> of the robot file{simulated && ", of a simulated robot: not for a real one"}
      </p>
      <dl>{gains.map(([name, gain]) => <div key={name}><dt>{name}</dt><dd>{gain}</dd></div>)}</dl>
    </div>
  );
}

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
      <h3>Guided</h3>
      <div class="row" role="group" aria-label="Guided">
        {PROCEDURES.map(([procedure, text]) => (
          <button
            key={procedure} type="button" disabled={Boolean(blockedBy || status.job)}
            onClick={() => void beginProcedure(status, procedure, text)}
          >
            {text}
          </button>
        ))}
      </div>
      {status.tuning && <TunedGains tuning={status.tuning} />}
    </section>
  );
}
