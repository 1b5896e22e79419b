// A button that heats or moves the robot at once.

import type { ComponentChildren } from "preact";
import { isSecondClick } from "./second_click";

interface HeatingButtonProps {
  onPress(): void;
  disabled?: boolean;
  children: ComponentChildren;
  "aria-describedby"?: string;
  class?: string;
}

export function HeatingButton({ onPress, children, ...rest }: HeatingButtonProps) {
  const press = (event: MouseEvent) => { if (!isSecondClick(event)) onPress(); };
  return <button type="button" {...rest} onClick={press}>{children}</button>;
}
