// Messages between the page and the 3D view in its frame (growbot-pictures/viewer/src/embedding.js).

import type { PlanResponse } from "./api_types";

/** A temperature: time in s, temperature and target in C. The target is null while the heater is off. */
export type Reading = [time: number, celsius: number, target: number | null];

/** The body that the view shows, with at most a few hundred points along it. */
export interface BodyMessage {
  kind: "body";
  layers: number;
  total: number;
  lengthMm: number;
  plannedMm: number;
  /** Points along the body: length, deviation from the plan and layer height, mm. */
  lengths: number[];
  heights: number[];
  /** Null for a plan. */
  deviations: number[] | null;
  latestDeviationMm: number | null;
  maxDeviationMm: number | null;
  /** Distance of the reached position from the goal. Null before the end. */
  goalErrorMm: number | null;
}

/** The part of the body that the slider of the view shows. */
export interface CursorMessage {
  kind: "cursor";
  layers: number;
  lengthMm: number;
  position: [number, number, number];
  heading: number;
  pitch: number;
}

/** Temperatures since the start of the growth. */
export interface ReadingsMessage {
  kind: "readings";
  readings: Reading[];
}

/** The position to which a person drags the goal, mm. */
export interface GoalMessage {
  kind: "goal";
  /** Null if the drag is cancelled. */
  position: [number, number, number] | null;
  /** False while the goal moves. */
  isDropped: boolean;
}

export type ViewerMessage = BodyMessage | CursorMessage | ReadingsMessage | GoalMessage;

/** All that the view has sent about the body that it shows. */
export interface ViewedBody {
  body: BodyMessage | null;
  cursor: CursorMessage | null;
  readings: Reading[] | null;
}

/** Returns the message in an event if it is from the view in this frame. */
export function readMessage(event: MessageEvent, frame: HTMLIFrameElement | null): ViewerMessage | null {
  if (event.origin !== location.origin || !frame || event.source !== frame.contentWindow) return null;
  return event.data?.growbot ?? null;
}

const send = (frame: HTMLIFrameElement | null, message: object) =>
  frame?.contentWindow?.postMessage({ growbot: message }, location.origin);

/** Moves the slider of the view in this frame to a length of the body. */
export function moveCursor(frame: HTMLIFrameElement | null, lengthMm: number): void {
  send(frame, { kind: "cursor", lengthMm });
}

/** Draws a path to the dragged goal in the view in this frame. `points` are its centreline, mm. */
export function drawPath(frame: HTMLIFrameElement | null, points: PlanResponse["centreline_mm"]): void {
  send(frame, { kind: "path", points });
}
