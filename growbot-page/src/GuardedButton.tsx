// A button that heats or moves the robot at once, or that cannot be undone. A double click does not press it.

import type { ComponentChildren } from "preact";
import { showMessage } from "./page_state";
import { isSecondClick } from "./second_click";

interface GuardedButtonProps {
  /** Name of the robot that heats or moves. */
  robot: string;
  onPress(): void;
  disabled?: boolean;
  children: ComponentChildren;
  "aria-describedby"?: string;
  "aria-label"?: string;
  class?: string;
}

export function GuardedButton({ robot, onPress, children, ...rest }: GuardedButtonProps) {
  const press = (event: MouseEvent) => {
    if (!isSecondClick(event)) onPress();
    else showMessage(robot, "Ignored, because it came too soon after another click: press again", true);
  };
  return <button type="button" {...rest} onClick={press}>{children}</button>;
}
