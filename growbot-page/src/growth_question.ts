// The question before a robot heats for a new body.

import { formatDuration } from "./format";
import { jobs, showMessage } from "./page_state";
import { ask } from "./question";

/** What a person confirms: the name of the body, and what the robot does. */
export interface AskedGrowth {
  title: string;
  layers: number;
  durationS: number;
  /** What the growth does besides its plan. */
  options?: string;
  /** True if the body begins at the tip of the last one, which stays in place. */
  startsAtLastTip?: boolean;
}

const latestJob = (robot: string) => jobs.value?.find((job) => job.robot === robot)?.id;

/**
 * Asks whether the last body is removed, or in place for a body that begins at its tip, and whether the robot may heat.
 * Returns whether a person has confirmed that.
 */
export async function confirmGrowth(robot: string, growth: AskedGrowth): Promise<boolean> {
  const { title, layers, durationS, options, startsAtLastTip } = growth;
  const before = latestJob(robot);
  const place = startsAtLastTip ? "in place, with the robot at its tip" : "removed";
  const text = `Is the last body ${place}? ${robot} heats its nozzle, homes, and lays ${layers} layers in `
    + `${[formatDuration(durationS), options].filter(Boolean).join(", ")}.`;
  if (!await ask({ title, text, action: "Heat and grow", destroys: false })) return false;
  if (latestJob(robot) === before) return true;
  showMessage(robot, "Not grown, because the robot has begun another body since the question: look at it, and confirm "
    + "again", true);
  return false;
}
