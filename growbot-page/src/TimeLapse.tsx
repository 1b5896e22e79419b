// The pictures of a job, one of each layer, which can be played.

import { useEffect, useRef, useState } from "preact/hooks";
import { choices, picturedJobs, readSnapshots, showPictures, snapshotUrl, takeChoice } from "./cameras";
import { jobs } from "./page_state";

/** Min time for which each picture is shown, ms. */
const SHOWN_MS = 100;
/** Time after which pictures are looked for again, ms. */
const REFRESH_MS = 10_000;

export function TimeLapse({ robotName }: { robotName: string }) {
  const latest = jobs.value?.find(({ robot, laid, state }) => robot === robotName && (laid > 0 || state === "active"));
  const chosen = picturedJobs.value.get(robotName);
  const job = chosen ?? latest;
  const [layers, setLayers] = useState<number[]>([]);
  const [problem, setProblem] = useState("");
  // Null while the latest picture is shown.
  const [index, setIndex] = useState<number | null>(null);
  const [isPlaying, setPlaying] = useState(false);
  const heading = useRef<HTMLHeadingElement>(null);
  const timer = useRef<ReturnType<typeof setTimeout> | undefined>(undefined);
  const halt = () => {
    clearTimeout(timer.current);
    setPlaying(false);
  };
  useEffect(() => {
    let isShown = true;
    const refresh = async () => {
      if (!job || document.hidden) return;
      try {
        const found = await readSnapshots(job);
        if (!isShown) return;
        setLayers(found);
        setProblem("");
      } catch (error) {
        if (isShown) setProblem(`The pictures are not current: ${(error as Error).message}`);
      }
    };
    setLayers([]);
    setIndex(null);
    halt();
    void refresh();
    // The pictures of a body that is finished may still be on their way.
    const interval = setInterval(() => void refresh(), REFRESH_MS);
    document.addEventListener("visibilitychange", refresh);
    return () => {
      isShown = false;
      clearInterval(interval);
      clearTimeout(timer.current);
      document.removeEventListener("visibilitychange", refresh);
    };
  }, [job?.id]);
  useEffect(() => { if (chosen && takeChoice()) heading.current?.focus(); }, [choices.value]);
  if (!job) return null;
  const last = layers.length - 1;
  const at = Math.min(index ?? last, last);
  // The next picture is requested once this one is there.
  const onShown = () => {
    clearTimeout(timer.current);
    if (!isPlaying) return;
    timer.current = setTimeout(() => {
      if (at >= last) setPlaying(false);
      else setIndex(at + 1);
    }, SHOWN_MS);
  };
  const play = () => {
    if (isPlaying) {
      halt();
      return;
    }
    setIndex(at >= last ? 0 : at + 1);
    setPlaying(true);
  };
  return (
    <section class="time-lapse" aria-label="Time lapse">
      <h3 ref={heading} tabIndex={-1}>Time lapse of {job.name}</h3>
      {chosen && latest && chosen.id !== latest.id && (
        <button type="button" onClick={() => showPictures(robotName, null)}>Latest body</button>
      )}
      <p class="message error" role="status" aria-label="Problem of the time lapse">{problem}</p>
      {layers.length === 0 && !problem && <p class="note">No pictures of this body yet.</p>}
      {layers.length > 0 && (
        <>
          <img
            src={snapshotUrl(job, layers[at])} alt={`Layer ${layers[at] + 1} of ${job.name}`}
            onLoad={onShown} onError={onShown}
          />
          <div class="row">
            <button type="button" disabled={layers.length < 2} onClick={play}>
              {isPlaying ? "Freeze" : "Play"}
            </button>
            <input
              type="range" aria-label="Picture" min={0} max={last} value={at}
              aria-valuetext={`Layer ${layers[at] + 1} of ${job.layers}`}
              onInput={({ currentTarget }) => { halt(); setIndex(Number(currentTarget.value)); }}
            />
            <span>Layer {layers[at] + 1} of {job.layers}</span>
          </div>
        </>
      )}
    </section>
  );
}
