// Events of the service, requests to it, and its clock.

import { ServiceClock, followEvents, readResponse } from "./connection.js";

export const API = new URL("api/v1/", location.href).href;
export const clock = new ServiceClock();
/** Timeout of a request. Computing a plan can take long. A request that hangs occupies one of the few connections. */
const [READ_TIMEOUT_MS, WRITE_TIMEOUT_MS] = [10_000, 180_000];
/** Time without any message of the worker after which a page follows the events itself. */
const WORKER_SILENCE_MS = 40_000;

/**
 * Follows the events through the worker that all pages share, or alone if there is none. Calls `onMessage` with
 * `event`, `data` and `ageMs`. The event `lost` means that the connection is lost. The event `expired` means that the
 * service refuses the page's token.
 */
export function followService(onMessage) {
  let own = null;
  let heardAt = performance.now();
  const followAlone = () => {
    own ??= followEvents(`${API}events`, {
      onEvent: (event, data) => onMessage({ event, data, ageMs: 0 }),
      onLost: () => onMessage({ event: "lost" }),
      onExpired: () => onMessage({ event: "expired" }),
    });
  };
  if (!window.SharedWorker) {
    followAlone();
    return;
  }
  const worker = new SharedWorker("events-worker.js", { type: "module" });
  worker.addEventListener("error", followAlone);
  worker.port.addEventListener("message", ({ data: message }) => {
    // A worker whose token is refused is silent until a page is opened with another token.
    heardAt = message.event === "expired" ? Infinity : performance.now();
    if (!own) onMessage(message);
  });
  worker.port.start();
  window.addEventListener("pagehide", () => worker.port.postMessage("close"));
  setInterval(() => { if (performance.now() - heardAt > WORKER_SILENCE_MS) followAlone(); }, 1_000);
}

/**
 * Requests a path of the service, or sends a value or file to it. `timeMs` is the time at which a person gave an order.
 * Throws a `RejectionError` with the service's reason, or another error if there was no response.
 */
export async function request(path, body, { timeMs, signal } = {}) {
  const isWrite = body !== undefined;
  const timeout = AbortSignal.timeout(isWrite ? WRITE_TIMEOUT_MS : READ_TIMEOUT_MS);
  const options = { headers: {}, signal: signal ? AbortSignal.any([timeout, signal]) : timeout };
  if (timeMs !== undefined) options.headers["growbot-order-time"] = String(timeMs);
  if (isWrite) options.method = "POST";
  if (body instanceof File) options.body = body;
  else if (isWrite) {
    options.headers["content-type"] = "application/json";
    options.body = JSON.stringify(body);
  }
  return readResponse(await fetch(`${API}${path}`, options));
}
