// The queue of a robot: the bodies that wait, and the order to grow the first.

import { useEffect } from "preact/hooks";
import { formatDuration } from "./format";
import { GuardedButton } from "./GuardedButton";
import { canControl } from "./page_state";
import type { Robot } from "./page_state";
import {
  growQueued, moveQueuedToFront, optionsText, queueProblem, queues, refreshQueue, removeQueued,
} from "./queued_bodies";
import { growthBlockedBy } from "./robot_texts";

const REFRESH_MS = 10_000;

export function Queue({ robot }: { robot: Robot }) {
  const { name, job } = robot.status;
  useEffect(() => {
    void refreshQueue(name);
    const timer = setInterval(() => void refreshQueue(name), REFRESH_MS);
    return () => clearInterval(timer);
  }, [name, job]);
  const bodies = queues.value.get(name) ?? [];
  const isBlocked = growthBlockedBy(robot) !== "";
  return (
    <section class="queue" aria-label="Queue">
      <h3>Queue</h3>
      <p class="message error" role="status" aria-label="Problem of the queue">{queueProblem.value}</p>
      {bodies.length === 0 && !queueProblem.value && (
        <p class="note">Empty. A body can wait here until the last one is removed.</p>
      )}
      <ol>
        {bodies.map((body, index) => (
          <li key={body.id}>
            <span>
              {body.name}{" "}
              <span class="muted">
                {[`${body.length_mm.toFixed(1)} mm`, formatDuration(body.duration_s), optionsText(body)]
                  .filter(Boolean).join(", ")}
              </span>
            </span>
            {canControl.value === true && (
              <span class="row">
                {index === 0 ? (
                  <button type="button" disabled={isBlocked} onClick={() => void growQueued(name, body)}>
                    Grow next
                  </button>
                ) : (
                  <button
                    type="button" aria-label={`To front: ${body.name}`}
                    onClick={() => void moveQueuedToFront(name, body)}
                  >
                    To front
                  </button>
                )}
                <GuardedButton
                  robot={name} aria-label={`Remove ${body.name}`} onPress={() => void removeQueued(name, body)}
                >
                  Remove
                </GuardedButton>
              </span>
            )}
          </li>
        ))}
      </ol>
    </section>
  );
}
