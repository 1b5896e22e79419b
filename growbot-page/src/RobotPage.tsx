// The page of one robot: its state, the body in three dimensions with its charts, and the next body.

import { useRef, useState } from "preact/hooks";
import { BodyView } from "./BodyView";
import { Camera } from "./Camera";
import { cameras } from "./cameras";
import { Charts } from "./Charts";
import { Console } from "./Console";
import { dragGoal } from "./dragged_goal";
import { NextBody } from "./NextBody";
import { isGoalPreviewed } from "./next_body";
import { jobs } from "./page_state";
import type { Robot } from "./page_state";
import { PersonNeeded } from "./PersonNeeded";
import { chosenBodies, jobViewUrl, liveUrl } from "./shown_body";
import type { ChosenBody } from "./shown_body";
import { StateCard } from "./StateCard";
import { drawPath } from "./viewer_messages";
import type { ViewedBody, ViewerMessage } from "./viewer_messages";

const NOTHING: ViewedBody = { body: null, cursor: null, readings: null };

/** The growths of a robot since its page was opened: the active job, the latest one, and their number. */
interface Growths {
  active: string | null;
  latest: string | null;
  count: number;
}

/** Returns the growing body of a robot, otherwise its latest one, and the number of growths so far. */
function useOwnBody({ status }: Robot): { body: ChosenBody | null; growths: number } {
  const growths = useRef<Growths>({ active: null, latest: null, count: 0 });
  const before = growths.current;
  if (status.job && status.job !== before.active) {
    growths.current = { active: status.job, latest: status.job, count: before.count + 1 };
  } else if (!status.job) growths.current = { ...before, active: null };
  const { latest, count } = growths.current;
  // The frame of a growth that has ended shows its last state.
  if (latest) {
    const title = status.job ? "The growing body" : "The latest body";
    return { body: { title, url: liveUrl(latest) }, growths: count };
  }
  const job = jobs.value?.find(({ robot, laid }) => robot === status.name && laid > 0);
  return { body: job ? { title: `The latest body, ${job.name}`, url: jobViewUrl(job.id) } : null, growths: count };
}

export function RobotPage({ robot }: { robot: Robot }) {
  const { name } = robot.status;
  const { body: own, growths } = useOwnBody(robot);
  const chosen = chosenBodies.value.get(name) ?? null;
  const shown = chosen ?? own;
  // A body that is resumed is loaded again.
  const source = shown ? `${shown.url} ${chosen ? "" : growths}` : "";
  const [viewed, setViewed] = useState<{ source: string; of: ViewedBody }>({ source, of: NOTHING });
  const current = viewed.source === source ? viewed.of : NOTHING;
  const frame = useRef<HTMLIFrameElement>(null);
  const hear = (message: ViewerMessage) => {
    if (message.kind === "goal") {
      dragGoal(name, message, (points) => drawPath(frame.current, points));
      return;
    }
    setViewed((before) => {
      const of = before.source === source ? before.of : NOTHING;
      if (message.kind === "body") return { source, of: { ...of, body: message } };
      if (message.kind === "cursor") return { source, of: { ...of, cursor: message } };
      return { source, of: { ...of, readings: message.readings } };
    });
  };
  return (
    <>
      <PersonNeeded robot={robot} />
      <div class="robot-page">
        <StateCard robot={robot} body={!chosen && robot.status.job ? current.body : null} />
        <BodyView
          key={source} robotName={name} shown={shown} isChosen={chosen !== null} isGrowing={robot.status.job !== null}
          isGoalDraggable={Boolean(chosen?.isGoalDraggable) && isGoalPreviewed(name)}
          frame={frame} viewed={current} onMessage={hear}
        />
        <Charts robotName={name} viewed={current} frame={frame} />
        {cameras.value.has(name) && <Camera robotName={name} />}
        <NextBody robot={robot} />
      </div>
      <Console robotName={name} />
    </>
  );
}
