// The goal of the next body: five fields with units, each with its problem beside it.

import { useId } from "preact/hooks";
import { FIELDS, fieldsOf, withText } from "./goal";
import type { Goal } from "./goal";
import type { Problem } from "./next_body";

interface GoalFieldsProps {
  goal: Goal;
  anyDirection: boolean;
  problem: Problem | null;
  onChange(goal: Goal): void;
  onAnyDirection(anyDirection: boolean): void;
}

export function GoalFields({ goal, anyDirection, problem, onChange, onAnyDirection }: GoalFieldsProps) {
  const id = useId();
  const shown = fieldsOf(anyDirection);
  return (
    <>
      <div class="fields" role="group" aria-label="Goal">
        {FIELDS.map(({ name, label }) => (
          <label key={name} class={name}>{label}
            <input
              value={goal[name]} inputMode="text" autocomplete="off" spellcheck={false} disabled={!shown.includes(name)}
              aria-invalid={problem?.field === name} aria-describedby={problem?.field === name ? id : undefined}
              onInput={({ currentTarget }) => onChange(withText(goal, name, currentTarget.value))}
            />
          </label>
        ))}
      </div>
      <label class="check">
        <input
          type="checkbox" checked={anyDirection} onChange={({ currentTarget }) => onAnyDirection(currentTarget.checked)}
        />
        Any direction at the goal
      </label>
      <p class="field-problem" id={id} role="status" aria-label="Problem of the goal">{problem?.message ?? ""}</p>
    </>
  );
}
