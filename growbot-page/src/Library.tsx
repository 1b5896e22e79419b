// The library: kept plans, scenes and robot files, with a search.

import { useEffect, useState } from "preact/hooks";
import type { LibraryEntry } from "./api_types";
import {
  fileName, fileUrl, keepFile, keepPlan, library, libraryProblem, refreshLibrary, removeEntry, thumbnailUrl, useEntry,
} from "./library_entries";
import { formOf } from "./next_body";
import { canControl } from "./page_state";

const FILE_TYPES = ".json,.toml,.stl,.obj,.ply,.glb,.pcd";

function Entry({ robot, entry }: { robot: string; entry: LibraryEntry }) {
  const { kind, name, summary } = entry;
  /** Removes the entry, and moves the focus to the library, because the focused button is then gone. */
  const remove = async (button: HTMLElement) => {
    const section = button.closest<HTMLElement>("section");
    if (await removeEntry(robot, entry)) section?.focus();
  };
  return (
    <li>
      {kind !== "robot" && <img src={thumbnailUrl(entry)} alt="" loading="lazy" width="48" height="48" />}
      <span>{name} <span class="muted">{kind}, {summary}</span></span>
      <span class="row">
        {kind !== "robot" && (
          <button type="button" aria-label={`Use ${name}`} onClick={() => void useEntry(robot, entry)}>Use</button>
        )}
        <a href={fileUrl(entry)} download={fileName(entry)} aria-label={`Download ${name}`}>File</a>
        {canControl.value === true && (
          <button
            type="button" aria-label={`Remove ${name} from the library`}
            onClick={({ currentTarget }) => void remove(currentTarget)}
          >
            Remove
          </button>
        )}
      </span>
    </li>
  );
}

/** Asks for the name under which the plan of the next body is kept. */
function KeepPlan({ robot }: { robot: string }) {
  const [name, setName] = useState("");
  const { plan } = formOf(robot);
  if (!plan) return null;
  const submit = (event: Event) => {
    event.preventDefault();
    void keepPlan(robot, name, plan).then((isKept) => { if (isKept) setName(""); });
  };
  return (
    <form class="row" onSubmit={submit}>
      <input
        aria-label="Name for the plan of the preview" placeholder="Name for this plan" value={name} required
        maxLength={100} onInput={({ currentTarget }) => setName(currentTarget.value)}
      />
      <button type="submit">Keep plan</button>
    </form>
  );
}

export function Library({ robot }: { robot: string }) {
  const [search, setSearch] = useState("");
  useEffect(() => { void refreshLibrary(); }, []);
  const all = library.value ?? [];
  const words = search.trim().toLowerCase();
  const shown = all.filter(({ kind, name, summary }) => `${kind} ${name} ${summary}`.toLowerCase().includes(words));
  return (
    <section class="library" aria-label="Library" tabIndex={-1}>
      <h3>Library</h3>
      <p class="message error" role="status" aria-label="Problem of the library">{libraryProblem.value}</p>
      {all.length > 0 && (
        <input
          type="search" aria-label="Search the library" placeholder="Search" value={search}
          onInput={({ currentTarget }) => setSearch(currentTarget.value)}
        />
      )}
      {library.value && shown.length === 0 && (
        <p class="note">
          {all.length ? "Nothing matches the search." : "Empty. Plans, scenes and robot files can be kept here."}
        </p>
      )}
      <ol>{shown.map((entry) => <Entry key={entry.id} robot={robot} entry={entry} />)}</ol>
      {canControl.value === true && (
        <>
          <KeepPlan robot={robot} />
          <label>Keep a file: plan, scene or robot
            <input
              type="file" accept={FILE_TYPES}
              onChange={({ currentTarget }) => {
                const [file] = currentTarget.files ?? [];
                if (file) void keepFile(robot, file).then(() => { currentTarget.value = ""; });
              }}
            />
          </label>
        </>
      )}
    </section>
  );
}
