// The next body of each robot: what has been entered, and its plan.

import { signal } from "@preact/signals";
import type { GrowRequest, Job, Plan, PlanResponse } from "./api_types";
import { EMPTY_TARGET, missingField, placeOfError, targetText } from "./goal";
import type { FieldName, Target } from "./goal";
import { readJobPlan, refreshJobs } from "./job_list";
import { sendOrder } from "./orders";
import { runAction } from "./robot_commands";
import { clock, request, robotPath } from "./service";
import { chooseBody, planViewUrl } from "./shown_body";

/** A plan in place of a goal: from a file, or that of an earlier job. */
export interface GivenPlan {
  name: string;
  plan: unknown;
  /** Name of the plan's scene in the service. */
  scene?: string;
}

/** A scene to avoid: a file, or a scene that the service has stored under a name. */
export type ChosenScene = File | { name: string; stored: string };

/** A problem of what is entered. The field is `undefined` if the problem is not about one. */
export interface Problem {
  field?: FieldName | "scene";
  /** Number of the waypoint that the problem is about, from 1. */
  waypoint?: number;
  message: string;
}

export interface NextBodyForm {
  source: "goal" | "plan";
  /** Job of the last body, if the body begins at its tip. Null if it begins at the base. */
  continued: string | null;
  waypoints: Target[];
  target: Target;
  given: GivenPlan | null;
  scene: ChosenScene | null;
  feedback: boolean;
  force: boolean;
  ignoreScene: boolean;
  /** Field with a problem, and the problem. */
  problem: Problem | null;
  /** The plan of what is entered. Null before the preview, and after a change. */
  plan: Plan | null;
  isPlanning: boolean;
  /** Number of changes of what is entered. A plan of an earlier state is not that of this one. */
  revision: number;
}

export const EMPTY_FORM: NextBodyForm = {
  source: "goal", continued: null, waypoints: [], target: EMPTY_TARGET, given: null, scene: null,
  feedback: false, force: false, ignoreScene: false, problem: null, plan: null, isPlanning: false, revision: 0,
};

export const forms = signal<ReadonlyMap<string, NextBodyForm>>(new Map());
/** The preview that is being planned for a robot. */
const planning = new Map<string, AbortController>();
/** Names under which the service stores the scenes of this page's files. */
const storedScenes = new WeakMap<File, string>();

export const formOf = (robot: string) => forms.value.get(robot) ?? EMPTY_FORM;

function update(robot: string, changes: Partial<NextBodyForm>): void {
  forms.value = new Map(forms.value).set(robot, { ...formOf(robot), ...changes });
}

/** Changes what is entered, so that the plan and its problem are not current any more. */
export function enter(robot: string, changes: Partial<NextBodyForm>): void {
  update(robot, { problem: null, plan: null, ...changes, revision: formOf(robot).revision + 1 });
}

export async function choosePlanFile(robot: string, file: File | undefined): Promise<void> {
  if (!file) return;
  try {
    enter(robot, { given: { name: file.name, plan: JSON.parse(await file.text()) } });
  } catch (error) {
    const { message } = error as Error;
    const problem = `${file.name} is not a plan (${message}): choose a file written by \`growbot plan -o\``;
    enter(robot, { given: null, problem: { message: problem } });
  }
}

/** Returns the name under which the service stores a scene. Uploads the scene unless this page has done that. */
export async function storeScene(file: ChosenScene): Promise<string> {
  if (!(file instanceof File)) return file.stored;
  const stored = storedScenes.get(file);
  if (stored !== undefined) return stored;
  const { scene } = await request<{ scene: string }>(`scenes?name=${encodeURIComponent(file.name)}`, file);
  storedScenes.set(file, scene);
  return scene;
}

/** Returns the request to grow or to plan what is entered. */
export async function requestOf(form: NextBodyForm): Promise<GrowRequest> {
  const { source, continued, waypoints, target, given, scene, feedback, force, ignoreScene } = form;
  const options: GrowRequest = { feedback, force, ignore_scene: ignoreScene };
  if (scene) options.scene = await storeScene(scene);
  if (source === "goal") {
    const from = continued === null ? undefined : `tip:${continued}`;
    return { ...options, from, via: waypoints.map(targetText), to: targetText(target) };
  }
  return { scene: given?.scene, ...options, plan: given?.plan, name: given?.name };
}

/** Returns whether the goal that is entered is that of the preview. */
export function isGoalPreviewed(robot: string): boolean {
  const { source, plan } = formOf(robot);
  return source === "goal" && plan !== null;
}

/** Returns the path of the API that plans for a robot. */
export const plansPath = (robot: string) => `plans?robot=${encodeURIComponent(robot)}`;

/** Returns what is missing in the form. Null if it is complete. */
function problemOf({ source, waypoints, target, given }: NextBodyForm): Problem | null {
  if (source === "plan") return given ? null : { message: "Choose a plan file first." };
  const fields = [...waypoints, target].map(missingField);
  const index = fields.findIndex((missing) => missing !== undefined);
  if (index < 0) return null;
  const field = fields[index];
  const isAngle = field === "heading" || field === "pitch";
  const message = `Enter ${isAngle ? "an angle in degrees, such as -45" : "a length in mm, such as 200"}.`;
  return { field, waypoint: index < waypoints.length ? index + 1 : undefined, message };
}

/** Plans what is entered, and shows the body. Returns whether what is entered then has a plan. */
export async function preview(robot: string): Promise<boolean> {
  const form = formOf(robot);
  const problem = problemOf(form);
  if (problem) {
    update(robot, { problem });
    return false;
  }
  // The service gives up a plan for which no page waits any more.
  planning.get(robot)?.abort();
  const own = new AbortController();
  planning.set(robot, own);
  const isCurrent = () => formOf(robot).revision === form.revision && !own.signal.aborted;
  update(robot, { isPlanning: true, problem: null });
  try {
    const { signal } = own;
    const { plan, view_path: view } = await request<PlanResponse>(plansPath(robot), await requestOf(form), { signal });
    if (!isCurrent() || view === null) return false;
    update(robot, { plan });
    const isGoalDraggable = form.source === "goal";
    chooseBody(robot, { title: "Preview of the next body", url: planViewUrl(view), isGoalDraggable });
    return true;
  } catch (error) {
    const { message } = error as Error;
    const isAboutScene = form.scene !== null && message.includes(form.scene.name);
    const found: Problem = { ...(isAboutScene ? { field: "scene" } : placeOfError(message)), message };
    if (isCurrent()) update(robot, { plan: null, problem: found });
    return false;
  } finally {
    if (planning.get(robot) === own) {
      planning.delete(robot);
      update(robot, { isPlanning: false });
    }
  }
}

/** Grows what was entered in this form. A person has just confirmed it. */
export async function grow(robot: string, form: NextBodyForm): Promise<void> {
  const timeMs = clock.now();
  await runAction(robot, "Grow", async () => {
    const job = await sendOrder<Job>(`Grow on ${robot}`, `${robotPath(robot)}/jobs`, await requestOf(form), timeMs);
    chooseBody(robot, null);
    // That body is not the last one any more.
    if (form.continued !== null) enter(robot, { continued: null });
    void refreshJobs();
    return `Job ${job.id} started`;
  });
}

/** Enters the plan of an earlier job as the next body, and shows it. */
export function growAgain(job: Job): void {
  void runAction(job.robot, "Grow again", async () => {
    const { plan, feedback, ignoreScene } = await readJobPlan(job);
    if ((plan as Plan).existing_layers) {
      throw new Error(`${job.name} began at the tip of another body: plan its goal again from the last one`);
    }
    const file = (plan as Plan).scene?.file;
    const given = { name: job.name, plan, scene: file?.split("/").at(-1) };
    enter(job.robot, { source: "plan", given, feedback, ignoreScene, force: false, scene: null });
    const isPlanned = await preview(job.robot);
    return `${job.name} ${isPlanned ? "is entered as the next body" : "cannot be grown again now"}`;
  });
}
