// The history: past and active jobs, with what a person can do with them.

import { useEffect, useState } from "preact/hooks";
import type { Job, JobState } from "./api_types";
import { cameras, showPictures } from "./cameras";
import { GuardedButton } from "./GuardedButton";
import { formatDuration, formatTime } from "./format";
import { readResults, results } from "./job_results";
import { growAgain } from "./next_body";
import { canControl, fragmentOf, jobs, jobsProblem, robots } from "./page_state";
import { resumableJob, resume } from "./robot_commands";
import { API } from "./service";
import { compareJob } from "./shown_body";

const FILTERS: [JobState | "", string][] =
  [["", "All results"], ["active", "Active"], ["done", "Done"], ["interrupted", "Interrupted"], ["failed", "Failed"]];

/** Number of jobs whose result is read. */
const MAX_READ = 10;

const resultText = ({ state, reason }: Job) => (reason && reason !== state ? `${state}: ${reason}` : state);

/** Returns the time from the creation of a job to its end. */
function durationText({ created_utc: created, ended_utc: ended }: Job): string {
  return ended ? formatDuration((Date.parse(ended) - Date.parse(created)) / 1000) : "";
}

function JobRow({ job, withRobot }: { job: Job; withRobot: boolean }) {
  const robot = robots.value.get(job.robot);
  const error = results.value.get(job.id)?.position_error_mm;
  const isResumable = canControl.value === true && robot !== undefined && resumableJob(robot)?.id === job.id;
  // The view and the form are on the page of the robot.
  const select = () => { location.hash = fragmentOf(job.robot); };
  return (
    <tr>
      <td data-label="Name"><span>{job.name}{job.simulated && <span class="muted"> simulated</span>}</span></td>
      {withRobot && <td data-label="Robot">{job.robot}</td>}
      <td data-label="Result"><span class={`tag ${job.state}`}>{resultText(job)}</span></td>
      <td data-label="Layers">{job.laid} of {job.layers}</td>
      <td data-label="Length">{job.length_mm.toFixed(1)} mm</td>
      <td data-label="Goal error">{error === undefined || error === null ? "–" : `${error.toFixed(2)} mm`}</td>
      <td data-label="Started">{formatTime(job.created_utc)}</td>
      <td data-label="Took">{durationText(job)}</td>
      <td class="actions">
        {job.laid > 0 && robot && (
          <button type="button" onClick={() => { select(); compareJob(job); }}>Compare</button>
        )}
        {job.laid > 0 && cameras.value.has(job.robot) && (
          <button type="button" onClick={() => { select(); showPictures(job.robot, job); }}>Pictures</button>
        )}
        {robot && (job.laid > 0 || job.state === "done") && (
          <button type="button" onClick={() => { select(); growAgain(job); }}>Grow again</button>
        )}
        {isResumable && <GuardedButton robot={job.robot} onPress={() => void resume(job)}>Resume</GuardedButton>}
        {(job.laid > 0 || job.state === "active") && <a href={`${API}jobs/${job.id}/log`}>Run log</a>}
      </td>
    </tr>
  );
}

/** Shows the jobs of a robot, or of all if its name is null. */
export function History({ robotName }: { robotName: string | null }) {
  const [search, setSearch] = useState("");
  const [filter, setFilter] = useState<JobState | "">("");
  const all = (jobs.value ?? []).filter((job) => robotName === null || job.robot === robotName);
  const words = search.trim().toLowerCase();
  const isFound = (job: Job) => `${job.name} ${job.robot} ${job.id} ${resultText(job)}`.toLowerCase().includes(words);
  const shown = all.filter((job) => (!filter || job.state === filter) && isFound(job));
  const withRobot = robotName === null;
  useEffect(() => { void readResults(shown.slice(0, MAX_READ)); }, [jobs.value]);
  return (
    <section class="card history" aria-label="History">
      <div class="history-bar">
        <h2>History</h2>
        <input
          type="search" aria-label="Search the history" placeholder="Search" value={search}
          onInput={({ currentTarget }) => setSearch(currentTarget.value)}
        />
        <select
          aria-label="Filter by result" value={filter}
          onChange={({ currentTarget }) => setFilter(currentTarget.value as JobState | "")}
        >
          {FILTERS.map(([state, label]) => <option key={state} value={state}>{label}</option>)}
        </select>
      </div>
      {shown.length > 0 && (
        <table>
          <thead>
            <tr>
              <th>Name</th>{withRobot && <th>Robot</th>}<th>Result</th><th>Layers</th><th>Length</th>
              <th>Goal error</th><th>Started</th><th>Took</th><th><span class="hidden">Commands</span></th>
            </tr>
          </thead>
          <tbody>{shown.map((job) => <JobRow key={job.id} job={job} withRobot={withRobot} />)}</tbody>
        </table>
      )}
      {jobs.value && shown.length === 0 && (
        <p class="note">{all.length ? "No job matches the search and the filter." : "No jobs yet."}</p>
      )}
      <p class="message error" role="status" aria-label="Problem of the history">{jobsProblem.value}</p>
    </section>
  );
}
