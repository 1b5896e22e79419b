// The connection of a page to growbot: a stream of events that reconnects, and a socket for commands.
//
// A browser opens about six HTTP connections to a host for all tabs, and queues further requests. It does not count
// WebSockets among them. So events and commands use WebSockets. Where none gets through, for example because of a
// proxy, events are server-sent events, and commands are requests.

/** Age beyond which data are stale. */
export const STALE_MS = 5_000;
/** Time after which a person is told that an order is not confirmed. */
export const CONFIRM_MS = 2_000;
/** Time without an event after which a stream counts as broken. growbot sends a heartbeat every 2 s. */
const SILENCE_MS = 8_000;
/** First and maximum delay of a reconnection. */
const [FIRST_DELAY_MS, MAX_DELAY_MS] = [500, 10_000];
const EVENT_NAMES = ["heartbeat", "robots", "recovery", "update", "end"];

/** Returns the delay before a reconnection. Half of it is random, so that many pages do not return at once. */
export function retryDelay(failures) {
  return Math.min(MAX_DELAY_MS, FIRST_DELAY_MS * 2 ** failures) * (0.5 + Math.random() / 2);
}

/** Status of a response to a request whose token is not, or no longer, that of the service. */
const UNAUTHORIZED = 401;

/** Returns whether growbot refuses the token of this page. A WebSocket that fails does not reveal why. */
async function isTokenRefused(url) {
  try {
    const { status } = await fetch(url, { method: "HEAD", signal: AbortSignal.timeout(CONFIRM_MS) });
    return status === UNAUTHORIZED;
  } catch {
    // growbot does not respond.
    return false;
  }
}

const socketUrl = (url) => `${url}/ws`.replace(/^http/, "ws");

/** Opens a WebSocket with events. Calls `hear(event, data)` for each, and `lose()` if it is closed. */
function openSocket(url, hear, lose) {
  const socket = new WebSocket(socketUrl(url));
  socket.addEventListener("message", ({ data: text }) => {
    const { event, data } = JSON.parse(text);
    hear(event, data);
  });
  for (const end of ["error", "close"]) socket.addEventListener(end, lose);
  return socket;
}

/** Opens a stream of server-sent events, like `openSocket`. */
function openEventSource(url, hear, lose) {
  const source = new EventSource(url);
  for (const name of EVENT_NAMES) source.addEventListener(name, ({ data }) => hear(name, JSON.parse(data)));
  source.addEventListener("error", lose);
  return source;
}

/**
 * Follows the events at an absolute URL until `stop()` of the returned value is called. Calls `onEvent(event, data)`
 * for each, and `onLost()` each time that the connection is lost or cannot be made. If growbot refuses the page's
 * token, it calls `onExpired()` and stops, because the page cannot connect again.
 */
export function followEvents(url, { onEvent, onLost, onExpired }) {
  let failures = 0;
  let useSocket = true;
  let socketWorks = false;
  let current = null;
  let timer = null;
  let isStopped = false;
  const stop = () => {
    isStopped = true;
    clearTimeout(timer);
    current?.close();
  };
  const checkToken = async () => {
    if (!await isTokenRefused(url) || isStopped) return;
    stop();
    onExpired();
  };
  const connect = () => {
    let watchdog = null;
    let isHeard = false;
    const connection = {
      close() {
        clearTimeout(watchdog);
        current = null;
        connection.source.close();
      },
    };
    const lose = () => {
      if (current !== connection) return;
      connection.close();
      if (!isHeard) useSocket = socketWorks || !useSocket;
      onLost();
      timer = setTimeout(connect, retryDelay(failures));
      failures += 1;
      checkToken();
    };
    const watch = () => {
      clearTimeout(watchdog);
      watchdog = setTimeout(lose, SILENCE_MS);
    };
    const hear = (event, data) => {
      if (current !== connection) return;
      [isHeard, failures] = [true, 0];
      socketWorks ||= useSocket;
      watch();
      onEvent(event, data);
    };
    current = connection;
    connection.source = (useSocket ? openSocket : openEventSource)(url, hear, lose);
    watch();
  };
  connect();
  return { stop };
}

/** Error of an order to which growbot has responded. Other errors leave open whether the order has arrived. */
export class RejectionError extends Error {
  constructor(status, body) {
    super(body?.detail || (typeof body === "string" && body) || `growbot returned HTTP status ${status}`);
    this.status = status;
  }
}

/** Returns the body of a response, or throws a `RejectionError`. */
function unwrapResponse(status, body) {
  if (status < 200 || status > 299) throw new RejectionError(status, body);
  return body;
}

/** Returns the body of a response to `fetch`, from JSON or as text, or throws a `RejectionError`. */
export async function readResponse(response) {
  let body = await response.text();
  try { body = JSON.parse(body); } catch { /* It is a text. */ }
  return unwrapResponse(response.status, body);
}

/** Opens a socket for commands at an absolute URL, and opens it again whenever it is closed. */
export function openCommands(url) {
  const waiting = new Map();
  let socket = null;
  let failures = 0;
  let latestId = 0;
  let isStopped = false;
  const connect = () => {
    if (isStopped) return;
    socket = new WebSocket(socketUrl(url));
    socket.addEventListener("open", () => {
      failures = 0;
      if (isStopped) socket.close();
    });
    socket.addEventListener("message", ({ data }) => {
      const { id, status, body } = JSON.parse(data);
      waiting.get(id)?.resolve({ status, body });
      waiting.delete(id);
    });
    socket.addEventListener("close", () => {
      for (const { reject } of waiting.values()) reject(new Error("the connection was lost"));
      waiting.clear();
      setTimeout(connect, retryDelay(failures));
      failures += 1;
    });
  };
  connect();
  return {
    /** Closes the socket for good. */
    stop() {
      isStopped = true;
      // Browsers report a warning if a socket is closed before it is open.
      if (socket.readyState === WebSocket.OPEN) socket.close();
    },
    /** True if a command can be sent now. */
    get isOpen() { return socket.readyState === WebSocket.OPEN; },
    /** Sends a command. Returns the body of the response. */
    async send(command) {
      latestId += 1;
      const id = latestId;
      const reply = new Promise((resolve, reject) => { waiting.set(id, { resolve, reject }); });
      socket.send(JSON.stringify({ id, ...command }));
      const { status, body } = await reply;
      return unwrapResponse(status, body);
    },
  };
}

/** Time after which a stop without a response is sent again, and after an attempt that failed. */
const [RESEND_MS, RETRY_MS] = [5_000, 1_000];
const BUSY = 503;

/**
 * Sends a stop until growbot has responded or `isClosed()` is true. Returns the body of the response. Sends it as the
 * `command` on the socket `commands`, and by `post(signal)` if the socket is closed or hangs. Calls `onFailure(error)`
 * after each attempt that failed.
 */
export function sendUntilAnswered({ commands, command, post, onFailure, isClosed }) {
  let isAnswered = false;
  let aborter = null;
  return new Promise((resolve, reject) => {
    const settle = (end, value) => {
      isAnswered = true;
      aborter?.abort();
      end(value);
    };
    const succeed = (body) => settle(resolve, body);
    const fail = (error) => {
      if (isAnswered || error.name === "AbortError") return;
      if (error instanceof RejectionError && error.status !== BUSY) settle(reject, error);
      else onFailure(error);
    };
    const send = (attempt) => {
      if (isAnswered) return;
      if (isClosed()) {
        settle(reject, new Error("the stop is not sent any more, because its message was closed"));
        return;
      }
      const isSocketOpen = commands?.isOpen;
      if (isSocketOpen) commands.send(command).then(succeed, fail);
      if (!isSocketOpen || attempt > 0) {
        aborter?.abort();
        aborter = new AbortController();
        post(aborter.signal).then(succeed, fail);
      }
      setTimeout(() => send(attempt + 1), isSocketOpen ? RESEND_MS : RETRY_MS * Math.min(5, attempt + 1));
    };
    send(0);
  });
}

/** Clock of growbot, as heartbeats show it. A heartbeat that arrives late makes an order look older, never younger. */
export class ServiceClock {
  #offset = null;

  /** Sets the clock by a heartbeat that arrived `ageMs` ago. */
  set(timeMs, ageMs = 0) {
    this.#offset = timeMs + ageMs - performance.now();
  }

  /** Returns the present time, in whole ms. `undefined` before the first heartbeat. */
  now() {
    return this.#offset === null ? undefined : Math.max(0, Math.round(this.#offset + performance.now()));
  }
}
