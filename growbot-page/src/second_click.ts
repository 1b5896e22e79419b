// Recognises the second click of a double click. When a command changes the page, another button may come under the
// pointer, and the second click must not press a button that heats.

const DOUBLE_CLICK_MS = 700;
let last = { target: null as EventTarget | null, at: -Infinity };
let before = last;

document.addEventListener("click", ({ target, detail }) => {
  // Keys click with a detail of 0.
  if (detail === 0) return;
  before = last;
  last = { target, at: performance.now() };
}, true);

/** Returns whether this click closely follows a click on another element. */
export function isSecondClick(event: MouseEvent): boolean {
  return event.detail > 0 && before.target !== event.target && performance.now() - before.at < DOUBLE_CLICK_MS;
}
