// The camera of a robot: its current picture, and the pictures of a job.

import { useEffect, useState } from "preact/hooks";
import { STALE_MS } from "../../growbot-pictures/viewer/src/connection.js";
import { followCamera } from "./cameras";
import type { CameraPicture } from "./cameras";
import { formatDuration } from "./format";
import { now } from "./page_state";
import { TimeLapse } from "./TimeLapse";

export function Camera({ robotName }: { robotName: string }) {
  const [picture, setPicture] = useState<CameraPicture | null>(null);
  useEffect(() => followCamera(robotName, setPicture), [robotName]);
  const ageMs = picture?.url ? Math.max(0, now.value - picture.at) : 0;
  const isOld = ageMs > STALE_MS;
  const problem = picture?.problem ? `No picture: ${picture.problem}` : "";
  const age = isOld ? `This picture is ${formatDuration(ageMs / 1000)} old.` : "";
  return (
    <section class="card camera" aria-label="Camera">
      <h2>Camera</h2>
      <div class="pictures">
        <div>
          {picture?.url && (
            <img
              src={picture.url} class={isOld ? "old" : ""}
              alt={`Camera of ${robotName}${isOld ? ", an old picture" : ""}`}
            />
          )}
          {!picture && <p class="note">Waiting for the first picture.</p>}
          {age && <p class="note">{age}</p>}
          <p class="message error" role="status" aria-label="Problem of the camera">{problem}</p>
        </div>
        <TimeLapse robotName={robotName} />
      </div>
    </section>
  );
}
