// Follows the events of the service for all open pages, so that together they need one connection.

import { followEvents } from "../../growbot-pictures/viewer/src/connection.js";

const pages = new Set<MessagePort>();
/** Latest message of each kind, for pages that are opened later. */
const latest = new Map<string, { event: string; data: unknown; at: number }>();
/** The stream of events. Null once the service refuses the token. */
let stream: unknown = null;

function publish(event: string, data: unknown): void {
  if (event !== "lost") latest.delete("lost");
  latest.set(event, { event, data, at: performance.now() });
  for (const page of pages) page.postMessage({ event, data, ageMs: 0 });
}

function follow(): void {
  latest.delete("expired");
  stream = followEvents(new URL("api/v1/events", self.location.href).href, {
    onEvent: publish,
    onLost: () => publish("lost", null),
    onExpired: () => {
      stream = null;
      publish("expired", null);
    },
  });
}

self.addEventListener("connect", (event) => {
  const [page] = (event as MessageEvent).ports;
  pages.add(page);
  // The only message of a page is that it is closed.
  page.addEventListener("message", () => pages.delete(page));
  page.start();
  // The browser has a new token if a page can be opened.
  if (!stream) follow();
  for (const { event: kind, data, at } of latest.values()) {
    page.postMessage({ event: kind, data, ageMs: performance.now() - at });
  }
});
