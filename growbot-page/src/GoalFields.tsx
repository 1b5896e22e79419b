// A goal or a waypoint: five fields with units, and their problem below them.

import { useId } from "preact/hooks";
import { FIELDS, fieldsOf, withText } from "./goal";
import type { Target } from "./goal";
import type { Problem } from "./next_body";

interface GoalFieldsProps {
  label: string;
  target: Target;
  problem: Problem | null;
  onChange(target: Target): void;
}

export function GoalFields({ label, target, problem, onChange }: GoalFieldsProps) {
  const id = useId();
  const { fields, anyDirection } = target;
  const shown = fieldsOf(anyDirection);
  const edit = (changes: Partial<Target>) => onChange({ ...target, ...changes });
  return (
    <div class="target" role="group" aria-label={label}>
      <div class="fields">
        {FIELDS.map(({ name, label: text }) => (
          <label key={name} class={name}>{text}
            <input
              value={fields[name]} inputMode="text" autocomplete="off" spellcheck={false}
              disabled={!shown.includes(name)} aria-invalid={problem?.field === name}
              aria-describedby={problem?.field === name ? id : undefined}
              onInput={({ currentTarget }) => edit({ fields: withText(fields, name, currentTarget.value) })}
            />
          </label>
        ))}
      </div>
      <label class="check">
        <input
          type="checkbox" checked={anyDirection}
          onChange={({ currentTarget }) => edit({ anyDirection: currentTarget.checked })}
        />
        Any direction at the {label.toLowerCase()}
      </label>
      <p class="field-problem" id={id} role="status" aria-label={`Problem of the ${label.toLowerCase()}`}>
        {problem?.message ?? ""}
      </p>
    </div>
  );
}
