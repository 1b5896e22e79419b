// The library of the service: plans, scenes and robot files under names.

import { signal } from "@preact/signals";
import type { LibraryEntry, NewLibraryEntry } from "./api_types";
import { enter, preview, storeScene } from "./next_body";
import { isExpired } from "./page_state";
import { ask } from "./question";
import { runAction } from "./robot_commands";
import { API, request } from "./service";

/** Entries, the latest first. Null before the service has sent them. */
export const library = signal<LibraryEntry[] | null>(null);
/** Problem of reading the library. Empty if there is none. */
export const libraryProblem = signal("");

export const fileUrl = ({ id }: LibraryEntry) => `${API}library/${id}/file`;
/** Returns the name of the file of an entry, with the extension of its format. */
export const fileName = ({ kind, name, scene }: LibraryEntry) =>
  `${name}.${{ plan: "json", robot: "toml", scene: scene?.split(".").at(-1) }[kind]}`;
export const thumbnailUrl = ({ id }: LibraryEntry) => `${API}library/${id}/thumbnail`;

/** Requests the entries. */
export async function refreshLibrary(): Promise<void> {
  if (isExpired.value) return;
  try {
    library.value = await request<LibraryEntry[]>("library");
    libraryProblem.value = "";
  } catch (error) {
    libraryProblem.value = `The library is not current: ${(error as Error).message}`;
  }
}

function keep(robot: string, entry: () => Promise<NewLibraryEntry>): Promise<boolean> {
  return runAction(robot, "Keep in library", async () => {
    const { name } = await request<LibraryEntry>("library", await entry());
    void refreshLibrary();
    return `${name} is in the library`;
  });
}

/** Keeps the plan of the next body under a name. */
export const keepPlan = (robot: string, name: string, plan: unknown) =>
  keep(robot, () => Promise.resolve({ name: name.trim(), plan }));

/** Keeps a file: a plan, a robot file, or a scene. */
export function keepFile(robot: string, file: File): Promise<boolean> {
  const name = file.name.replace(/\.[^.]*$/, "");
  return keep(robot, async () => {
    if (file.name.endsWith(".json")) return { name, plan: JSON.parse(await file.text()) };
    if (!file.name.endsWith(".toml")) return { name, scene: await storeScene(file) };
    const text = await file.text();
    return text.includes("growbot-scene/") ? { name, scene: await storeScene(file) } : { name, robot_file: text };
  });
}

/** Enters an entry as the next body, or its scene as the one to avoid. */
export function useEntry(robot: string, entry: LibraryEntry): Promise<boolean> {
  const { name, scene } = entry;
  return runAction(robot, "Use", async () => {
    if (entry.kind === "scene" && scene) {
      enter(robot, { scene: { name, stored: scene }, ignoreScene: false, force: false });
      return `${name} is entered as the scene to avoid`;
    }
    const plan = await request<unknown>(`library/${entry.id}/file`);
    const given = { name, plan, scene: scene ?? undefined };
    enter(robot, { source: "plan", given, force: false, ignoreScene: false, scene: null });
    return `${name} is entered as the next body${await preview(robot) ? "" : ", but cannot be grown as it is"}`;
  });
}

/** Removes an entry after a question. Returns whether it is removed. */
export async function removeEntry(robot: string, entry: LibraryEntry): Promise<boolean> {
  const { id, name } = entry;
  const text = "Growing and queued bodies keep what they use of it. It cannot be brought back from here.";
  const question = { title: `Remove ${name} from the library?`, text, action: "Remove", destroys: true };
  if (!await ask(question)) return false;
  return runAction(robot, "Remove from library", async () => {
    library.value = await request<LibraryEntry[]>(`library/${id}/remove`, {});
    return `${name} is removed from the library`;
  });
}
