// The commands of the console of a robot: those of `growbot console` that have no place of their own on the page. A
// line does what its button does, with the same conditions and the same question.

import type { CommandName } from "./api_types";
import { EMPTY_GOAL, FIELDS, fieldsOf } from "./goal";
import { confirmGrow } from "./grow_next_body";
import { TASKS } from "./maintenance_tasks";
import { EMPTY_FORM, enter, formOf } from "./next_body";
import { canControl, messages, robots } from "./page_state";
import type { Robot } from "./page_state";
import { allowedCommands, giveCommand, resumableJob, resume, runTask, stopRobots } from "./robot_commands";
import { ageText, commandHint, growthBlockedBy, maintenanceBlockedBy, stateText, temperatureText } from "./robot_texts";

interface ConsoleCommand {
  name: string;
  argument: string;
  help: string;
}

const TASK_ARGUMENTS: Record<string, string> =
  { preheat: "[C|MATERIAL]", load: "[MM|MATERIAL]", unload: "[MM|MATERIAL]", purge: "[MM|MATERIAL]",
    rotate: "DEGREES", jog: "MM" };

export const CONSOLE_COMMANDS: ConsoleCommand[] = [
  { name: "status", argument: "", help: "state of the robot" },
  { name: "start", argument: "", help: "continue after a pause, or resume the body that the board keeps" },
  { name: "pause", argument: "", help: "finish the current layer and wait; `start` continues" },
  { name: "grow", argument: "GOAL", help: "plan to X,Y,Z,HEADING,PITCH or X,Y,Z, ask, heat and grow" },
  { name: "stop", argument: "", help: "heater and steppers off" },
  { name: "estop", argument: "", help: "emergency stop: off at once, and off until `clear`" },
  { name: "clear", argument: "", help: "clear a fault or an emergency stop whose cause is gone" },
  { name: "help", argument: "", help: "this list" },
  ...TASKS.map(({ name, effect }) => ({ name, argument: TASK_ARGUMENTS[name] ?? "", help: effect })),
];

/** Commands of `growbot console` that have a place of their own, and that place. */
const ELSEWHERE: Record<string, string> = {
  plan: "press Preview under Next body",
  layers: "the 3D view shows the layers",
  wait: "the page shows what happens",
  quit: "the page has no end: a robot that grows continues without it",
  exit: "the page has no end: a robot that grows continues without it",
};
/** Commands that only look. */
const PASSIVE = ["status", "help"];

/** Response to a line. */
export interface ConsoleResponse {
  text: string;
  isError: boolean;
}

const error = (text: string): ConsoleResponse => ({ text, isError: true });

/** Returns the completions of a line: names of commands. */
export function complete(line: string): string[] {
  const begun = line.trimStart();
  if (begun.includes(" ")) return [];
  return CONSOLE_COMMANDS.filter(({ name }) => name.startsWith(begun))
    .map(({ name, argument }) => (argument ? `${name} ` : name));
}

/** Runs a line for a robot. */
export async function runLine(name: string, line: string): Promise<ConsoleResponse> {
  const [, word = "", rest = ""] = /^\s*(\S*)\s*([^]*?)\s*$/.exec(line) ?? [];
  const robot = robots.value.get(name);
  const command = CONSOLE_COMMANDS.find((known) => known.name === word);
  if (!command) {
    return error(ELSEWHERE[word] ? `\`${word}\` is not for this console: ${ELSEWHERE[word]}`
      : `unknown command "${word}": \`help\` lists the commands`);
  }
  if (canControl.value === false && !PASSIVE.includes(word)) {
    return error("this URL is read-only: open the control URL to give commands");
  }
  if (word === "estop") {
    // The rest of the line is ignored, so that a typing error does not prevent an emergency stop.
    await stopRobots([name]);
    return latestMessage(name);
  }
  if (rest && !command.argument) return error(`\`${word}\` takes no arguments: remove "${rest}"`);
  if (!robot) return error("the robot is not known yet: try again, or cut its power if it must be off");
  if (word === "help") return { text: helpText(), isError: false };
  if (word === "status") return { text: statusText(robot), isError: false };
  if (word === "stop") return give(name, "stop");
  if (canControl.value === null) return error("the rights of this page are not known yet: try again");
  const allowed = allowedCommands(robot);
  if (word === "pause") return allowed.pause ? give(name, "pause") : error(commandHint(robot));
  if (word === "clear") {
    if (allowed["clear-fault"]) return give(name, "clear-fault");
    const isLatched = robot.status.fault !== null || robot.status.state === "emergency-stop";
    return error(isLatched ? "the robot is not ready to be cleared: see its state, and try again"
      : "nothing is latched");
  }
  if (word === "start") {
    if (allowed.continue) return give(name, "continue");
    const job = resumableJob(robot);
    if (!job) return error("no body waits: `grow GOAL` grows a new one");
    await resume(job);
    return latestMessage(name);
  }
  if (word === "grow") return growGoal(robot, rest);
  const blockedBy = maintenanceBlockedBy(robot);
  if (blockedBy) return error(blockedBy);
  const task = TASKS.find((known) => known.name === word);
  if (robot.status.job && !task?.inPause) return error(`\`${word}\` is not possible in a pause: press Stop first`);
  if (robot.status.job && rest) return error(`in a pause \`${word}\` takes no value: remove "${rest}"`);
  await runTask(robot.status, word, rest);
  return latestMessage(name);
}

async function give(name: string, command: CommandName): Promise<ConsoleResponse> {
  await giveCommand(name, command);
  return latestMessage(name);
}

async function growGoal(robot: Robot, text: string): Promise<ConsoleResponse> {
  const { name } = robot.status;
  const blockedBy = growthBlockedBy(robot);
  if (blockedBy) return error(blockedBy);
  const parts = text.split(",").map((part) => part.trim());
  const anyDirection = parts.length === 3;
  if (parts.includes("") || ![3, FIELDS.length].includes(parts.length)) {
    return error("give X,Y,Z,HEADING,PITCH in mm and degrees, or X,Y,Z for any direction");
  }
  const fields = { ...EMPTY_GOAL };
  fieldsOf(anyDirection).forEach((field, index) => { fields[field] = parts[index]; });
  // The scene stays. The options of the form are those of another body.
  enter(name, { ...EMPTY_FORM, scene: formOf(name).scene, target: { fields, anyDirection } });
  if (await confirmGrow(name)) return latestMessage(name);
  return error(formOf(name).problem?.message ?? "not grown");
}

function latestMessage(name: string): ConsoleResponse {
  const message = messages.value.get(name);
  return message ?? { text: "done", isError: false };
}

function statusText(robot: Robot): string {
  const { status } = robot;
  const layers = status.layers ? `layer ${status.laid} of ${status.layers}` : "no body";
  return [stateText(robot), ageText(robot), status.fault_explanation, status.pause_explanation, layers,
    temperatureText(status)].filter(Boolean).join("\n");
}

const helpText = () => CONSOLE_COMMANDS.map(({ name, argument, help }) =>
  `${`${name} ${argument}`.padEnd(22)}${help}`).join("\n");
