// The body in three dimensions, in a frame with the viewer that `growbot view` has, too.

import type { RefObject } from "preact";
import { useEffect, useRef, useState } from "preact/hooks";
import { retryDelay } from "../../growbot-pictures/viewer/src/connection.js";
import { formatNumber } from "./format";
import { isExpired } from "./page_state";
import { chooseBody } from "./shown_body";
import type { ChosenBody } from "./shown_body";
import { readMessage } from "./viewer_messages";
import type { ViewedBody, ViewerMessage } from "./viewer_messages";

interface BodyViewProps {
  robotName: string;
  shown: ChosenBody | null;
  /** True if a person has chosen the body. */
  isChosen: boolean;
  /** True if a person can drag the goal of the body now. */
  isGoalDraggable: boolean;
  isGrowing: boolean;
  frame: RefObject<HTMLIFrameElement | null>;
  viewed: ViewedBody;
  onMessage(message: ViewerMessage): void;
}

/** Returns the text that stands for the picture. */
function describe({ body, cursor }: ViewedBody): string {
  if (!body) return "";
  const deviation = body.maxDeviationMm === null ? "" : `, at most ${body.maxDeviationMm.toFixed(2)} mm off the plan`;
  const error = body.goalErrorMm === null ? "" : `, ${body.goalErrorMm.toFixed(2)} mm from the goal`;
  const text = `${body.layers} of ${body.total} layers, ${body.lengthMm.toFixed(1)} mm${deviation}${error}.`;
  if (!cursor) return text;
  const at = cursor.position.map((part) => formatNumber(part, 1)).join(", ");
  return `${text} Tip at layer ${cursor.layers}: ${at} mm, heading ${formatNumber(cursor.heading, 1)}°, `
    + `pitch ${formatNumber(cursor.pitch, 1)}°.`;
}

export function BodyView(props: BodyViewProps) {
  const { robotName, shown, isChosen, isGoalDraggable, isGrowing, frame, viewed, onMessage } = props;
  const [attempt, setAttempt] = useState(0);
  const [problem, setProblem] = useState("");
  const listener = useRef(onMessage);
  listener.current = onMessage;
  useEffect(() => {
    const hear = (event: MessageEvent) => {
      const message = readMessage(event, frame.current);
      if (message) listener.current(message);
    };
    window.addEventListener("message", hear);
    return () => window.removeEventListener("message", hear);
  }, []);
  const section = useRef<HTMLElement>(null);
  useEffect(() => { if (shown?.isScrolledTo) section.current?.scrollIntoView({ block: "nearest" }); }, []);
  const retry = useRef<ReturnType<typeof setTimeout> | undefined>(undefined);
  useEffect(() => () => clearTimeout(retry.current), []);
  const check = () => {
    const loaded = frame.current?.contentDocument;
    if (loaded?.querySelector(".stage")) {
      setProblem("");
      return;
    }
    setProblem("The 3D view is not available yet. The page requests it again.");
    clearTimeout(retry.current);
    retry.current = setTimeout(() => { if (!isExpired.value) setAttempt(attempt + 1); }, retryDelay(attempt));
  };
  return (
    <section ref={section} class="card view" aria-label="Body in three dimensions">
      <div class="view-bar">
        <h2>{shown?.title ?? "Body"}</h2>
        {isChosen && (
          <button type="button" onClick={() => chooseBody(robotName, null)}>
            {isGrowing ? "Show growing body" : "Close"}
          </button>
        )}
        {shown && <a href={shown.url} target="_blank" rel="noopener">Open in new tab</a>}
      </div>
      {shown ? (
        <iframe
          key={attempt} ref={frame} src={shown.url} onLoad={check} data-growbot-view=""
          data-growbot-drag={shown.isGoalDraggable ? isGoalDraggable : undefined}
          title={`3D view of the body of ${robotName}`}
          class={problem ? "failed" : ""}
        />
      ) : (
        <p class="empty">No body yet. Enter a goal under Next body and press Preview: the body is shown here before
          anything heats.</p>
      )}
      <p class="caption" role={problem ? "status" : undefined}>
        {problem || `${describe(viewed)}${isGoalDraggable && viewed.body ? " Drag the goal to move it." : ""}`}
      </p>
    </section>
  );
}
