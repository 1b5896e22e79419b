// Values of the service's API that the page uses. The OpenAPI document of the service describes them.

/** Status of a robot. A field is null if it is not known. */
export interface RobotStatus {
  name: string;
  port: string;
  simulated: boolean;
  pace: number | null;
  connection: "disconnected" | "ready" | "busy";
  connection_error: string | null;
  status_age_s: number | null;
  robot: string | null;
  state: string | null;
  fault: string | null;
  fault_explanation: string | null;
  pause_cause: string | null;
  pause_explanation: string | null;
  temperature_c: number | null;
  target_c: number | null;
  plan_id: string | null;
  layers: number;
  laid: number;
  job: string | null;
  left_s: number | null;
  finish_utc: string | null;
  command_error: string | null;
  pending_stop: string | null;
  /** The interrupted layer of the body. */
  interrupted: object | null;
  /** Gains that the latest tuning of the heater in the service has found. */
  tuning: TuningReport | null;
}

/** Gains of the heater that a tuning has found. */
export interface TuningReport {
  kp: number;
  ki: number;
  kd: number;
  simulated: boolean;
}

/** Response to a command: its result as text, and the robot's status after it. */
export interface CommandResponse extends RobotStatus {
  message: string;
}

export type JobState = "active" | "interrupted" | "done" | "failed";

/** A job of the service. */
export interface Job {
  id: string;
  robot: string;
  name: string;
  state: JobState;
  plan_id: string;
  layers: number;
  laid: number;
  length_mm: number;
  simulated: boolean;
  created_utc: string;
  ended_utc: string | null;
  reason: string | null;
}

/** A body that waits for its robot. */
export interface QueuedBody {
  id: string;
  name: string;
  layers: number;
  length_mm: number;
  duration_s: number;
  feedback: boolean;
  force: boolean;
  ignore_scene: boolean;
}

export interface PlanWarning {
  code: string;
  message: string;
}

/** The part of a plan file that the page reads. */
export interface Plan {
  length_mm: number;
  layers: number;
  duration_s: number;
  filament_mm: number;
  warnings: PlanWarning[];
  scene?: { file: string; clearance_mm: number; margin_mm?: number };
  /** Layers of the body at whose tip the plan begins. */
  existing_layers?: string;
}

/** Response to a request for a plan. */
export interface PlanResponse {
  plan: Plan;
  centreline_mm: [number, number, number][];
  view_path: string | null;
}

/** A request to grow or to plan: either a goal `to`, or a plan. */
export interface GrowRequest {
  to?: string;
  /** Start pose, or `tip:` and the identifier of the job of the last body. */
  from?: string;
  via?: string[];
  plan?: unknown;
  name?: string;
  scene?: string;
  feedback: boolean;
  force: boolean;
  ignore_scene: boolean;
}

/** An entry of the library. */
export interface LibraryEntry {
  id: string;
  kind: "plan" | "scene" | "robot";
  name: string;
  summary: string;
  /** Name of the scene in the service: of this entry, or of its plan. */
  scene: string | null;
}

/** What is to be kept in the library: a name, and one of the others. */
export interface NewLibraryEntry {
  name: string;
  plan?: unknown;
  scene?: string;
  robot_file?: string;
}

/** Action of the page in a step of a guided sequence. */
export type RecoveryAction =
  | "clear-fault" | "continue" | "resume" | "stop" | "cancel" | "withdraw-stop" | "preheat" | "load" | "purge"
  | "cooldown" | "dry-run" | "home" | "jog" | "tune";

/** A step of a guided sequence. The person acts if it has no action. */
export interface RecoveryStep {
  text: string;
  action: RecoveryAction | null;
  /** Value of the maintenance task that the action runs. */
  value: string;
  effect: "safe" | "heats" | "moves" | "heats-and-moves" | "discards" | "may-stay-on";
}

/** The steps by which a person brings a robot out of a situation. */
export interface RecoverySequence {
  situation: string;
  /** True if the situation interrupts the sequence of another one. */
  interrupts: boolean;
  cause: string;
  safety: string;
  steps: RecoveryStep[];
  alternative: RecoveryStep | null;
}

/** Steps that a person begins. */
export interface Procedure {
  name: "calibration" | "commissioning";
  cause: string;
  safety: string;
  steps: RecoveryStep[];
}

/** Names of the commands to a robot. */
export type CommandName =
  | "pause" | "continue" | "stop" | "emergency-stop" | "clear-fault" | "cancel" | "withdraw-stop";
