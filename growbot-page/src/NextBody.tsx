// The next body: a goal or a plan, its preview, and the order to grow it.

import { useId } from "preact/hooks";
import { confirmGrow } from "./grow_next_body";
import { Library } from "./Library";
import { choosePlanFile, enter, formOf, preview } from "./next_body";
import type { NextBodyForm } from "./next_body";
import { canControl } from "./page_state";
import type { Robot } from "./page_state";
import { PathFields } from "./PathFields";
import { PlanSummary } from "./PlanSummary";
import { Queue } from "./Queue";
import { enqueue } from "./queued_bodies";
import { growthBlockedBy } from "./robot_texts";

/** Warnings because of which the service refuses a plan, unless it is forced. */
const BLOCKING = ["self-collision", "filament-short", "layer-limit"];
const SOURCES: [NextBodyForm["source"], string][] = [["goal", "Goal"], ["plan", "Plan"]];
const SCENE_TYPES = ".toml,.stl,.obj,.ply,.glb,.pcd";

async function confirmQueue(name: string): Promise<void> {
  if (!formOf(name).plan && !await preview(name)) return;
  const form = formOf(name);
  if (form.plan) await enqueue(name, form);
}

function Options({ robot, form }: { robot: string; form: NextBodyForm }) {
  const isForceable = form.force || form.plan?.warnings.some(({ code }) => BLOCKING.includes(code));
  const hasScene = form.scene || form.given?.scene || form.ignoreScene;
  const ignoring = (ignoreScene: boolean) => ({ ignoreScene, plan: null });
  const check = (label: string, checked: boolean, change: (checked: boolean) => Partial<NextBodyForm>) => (
    <label class="check">
      <input
        type="checkbox" checked={checked}
        onChange={({ currentTarget }) => enter(robot, { plan: form.plan, ...change(currentTarget.checked) })}
      />
      {label}
    </label>
  );
  return (
    <>
      {check("Feedback: measure each layer, plan the rest again", form.feedback, (feedback) => ({ feedback }))}
      {isForceable && check("Grow despite the warnings", form.force, (force) => ({ force }))}
      {hasScene && check("Ignore the scene: the body may collide", form.ignoreScene, ignoring)}
    </>
  );
}

export function NextBody({ robot }: { robot: Robot }) {
  const { status } = robot;
  const { name } = status;
  const sceneProblem = useId();
  const form = formOf(name);
  const reason = growthBlockedBy(robot);
  const isReadOnly = canControl.value === false;
  const isSceneWrong = form.problem?.field === "scene";
  return (
    <section class="card next-body" aria-label="Next body">
      <h2>Next body</h2>
      <div class="row" role="group" aria-label="Kind of the next body">
        {SOURCES.map(([source, label]) => (
          <button
            key={source} type="button" aria-pressed={form.source === source} onClick={() => enter(name, { source })}
          >
            {label}
          </button>
        ))}
      </div>
      <form onSubmit={(event) => { event.preventDefault(); void preview(name); }}>
        {form.source === "goal" ? (
          <PathFields status={status} form={form} />
        ) : (
          <>
            {form.given && <p class="note">Plan: {form.given.name}</p>}
            <label>Plan file
              <input
                type="file" accept=".json,application/json"
                onChange={({ currentTarget }) => void choosePlanFile(name, currentTarget.files?.[0])}
              />
            </label>
            <p class="field-problem" role="status" aria-label="Problem of the plan">
              {isSceneWrong ? "" : form.problem?.message}
            </p>
          </>
        )}
        <label>Scene to avoid (optional)
          <input
            key={form.scene?.name} type="file" accept={SCENE_TYPES} disabled={isReadOnly} aria-invalid={isSceneWrong}
            aria-describedby={sceneProblem}
            onChange={({ currentTarget }) => enter(name, { scene: currentTarget.files?.[0] ?? null })}
          />
        </label>
        {form.scene && (
          <p class="note">
            Scene: {form.scene.name}{" "}
            <button type="button" onClick={() => enter(name, { scene: null })}>Without this scene</button>
          </p>
        )}
        <p class="field-problem" id={sceneProblem} role="status" aria-label="Problem of the scene">
          {isSceneWrong ? form.problem?.message : ""}
        </p>
        <Options robot={name} form={form} />
        {form.plan && <PlanSummary plan={form.plan} robot={status} />}
        <div class="row">
          <button type="submit" disabled={form.isPlanning}>{form.isPlanning ? "Planning…" : "Preview"}</button>
          <button
            type="button" class="primary" disabled={Boolean(reason) || form.isPlanning}
            onClick={() => void confirmGrow(name)}
          >
            Grow
          </button>
        </div>
        <button
          type="button" disabled={isReadOnly || form.isPlanning}
          onClick={() => void confirmQueue(name)}
        >
          Add to queue
        </button>
        <p class="hint">{reason || "Preview heats nothing. Grow requests a confirmation before the robot heats."}</p>
      </form>
      <Queue robot={robot} />
      <Library robot={name} />
    </section>
  );
}
