// Events of the service, requests to it, and its clock.

import { ServiceClock, followEvents, readResponse } from "../../growbot-pictures/viewer/src/connection.js";

export const API = new URL("api/v1/", location.href).href;
export const clock = new ServiceClock();
/** Timeout of a request. Computing a plan can take long. A request that hangs occupies one of the few connections. */
const [READ_TIMEOUT_MS, WRITE_TIMEOUT_MS] = [10_000, 180_000];
/** Time without any message of the worker after which a page follows the events itself. */
const WORKER_SILENCE_MS = 40_000;

/** A message of the service. `ageMs` is the time since the page or the worker received it. */
export interface ServiceMessage {
  /** `heartbeat`, `robots`, `lost` (the connection is lost) or `expired` (the service refuses the page's token). */
  event: string;
  data?: unknown;
  ageMs?: number;
}

/** Follows the events through the worker that all pages share, or alone if there is none. */
export function followService(onMessage: (message: ServiceMessage) => void): void {
  let own: unknown = null;
  let heardAt = performance.now();
  const followAlone = () => {
    own ??= followEvents(`${API}events`, {
      onEvent: (event: string, data: unknown) => onMessage({ event, data, ageMs: 0 }),
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

/** Options of a request: the time at which a person gave the order, and a signal that aborts it. */
export interface RequestOptions {
  timeMs?: number;
  signal?: AbortSignal;
}

/**
 * Requests a path of the service, or sends a value or file to it. Throws a `RejectionError` with the service's reason,
 * or another error if there was no response.
 */
export async function request<T>(path: string, body?: unknown, { timeMs, signal }: RequestOptions = {}): Promise<T> {
  const isWrite = body !== undefined;
  const timeout = AbortSignal.timeout(isWrite ? WRITE_TIMEOUT_MS : READ_TIMEOUT_MS);
  const headers: Record<string, string> = {};
  const options: RequestInit = { headers, signal: signal ? AbortSignal.any([timeout, signal]) : timeout };
  if (timeMs !== undefined) headers["growbot-order-time"] = String(timeMs);
  if (isWrite) options.method = "POST";
  if (body instanceof File) options.body = body;
  else if (isWrite) {
    headers["content-type"] = "application/json";
    options.body = JSON.stringify(body);
  }
  return await readResponse(await fetch(`${API}${path}`, options)) as T;
}

/** Returns the path of a robot in the API. */
export const robotPath = (name: string) => `robots/${encodeURIComponent(name)}`;
