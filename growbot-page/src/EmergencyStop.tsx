// The emergency stop of the shown robot, or of all. Its place never changes. A press that has begun keeps its robots,
// also if the view changes before it ends.

import { useEffect, useRef, useState } from "preact/hooks";
import { showBanner } from "./banners";
import { canControl, robots, selectedName, stopTargets } from "./page_state";
import { stopRobots } from "./robot_commands";

/** Time after the end of a press in which its click may follow. */
const CLICK_FOLLOWS_MS = 600;

interface Press {
  targets: string[];
  label: string;
}

export function EmergencyStop() {
  const targets = stopTargets.value;
  const label = selectedName.value === null
    ? (targets.length ? "Stop all robots" : "Emergency stop") : `Emergency stop ${selectedName.value}`;
  const [press, setPress] = useState<Press | null>(null);
  const timer = useRef<ReturnType<typeof setTimeout> | undefined>(undefined);
  const begin = () => {
    clearTimeout(timer.current);
    setPress({ targets, label });
  };
  useEffect(() => {
    const end = () => {
      clearTimeout(timer.current);
      timer.current = setTimeout(() => setPress(null), CLICK_FOLLOWS_MS);
    };
    for (const event of ["pointerup", "pointercancel", "keyup", "blur"]) window.addEventListener(event, end);
    return () => {
      for (const event of ["pointerup", "pointercancel", "keyup", "blur"]) window.removeEventListener(event, end);
    };
  }, []);
  const stop = () => {
    const stopped = press?.targets.length ? press.targets : targets;
    setPress(null);
    if (stopped.length) void stopRobots(stopped);
    else showBanner("No robot is known yet: cut the robot's power, or run `growbot estop` on its machine.");
  };
  const isDisabled = canControl.value === false;
  return (
    <button
      type="button" id="emergency-stop" disabled={isDisabled} onClick={stop}
      onPointerDown={({ isPrimary }) => { if (isPrimary) begin(); }}
      onKeyDown={({ key, repeat }) => { if ((key === " " || key === "Enter") && !repeat) begin(); }}
      title={isDisabled ? "This URL is read-only: open the control URL." : `Turns everything off at once: ${
        (press?.targets ?? targets).join(", ") || [...robots.value.keys()].join(", ")}`}
    >
      {press?.label ?? label}
    </button>
  );
}
