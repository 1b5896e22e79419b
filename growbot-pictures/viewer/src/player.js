// The controls of time: slider, play button and keys.

/** Time in which the player shows the growth of a whole body, s. */
const PLAY_DURATION_S = 12;

/**
 * Connects the controls of the page to a body of `count` layers, or of another `unit`. `show(position)` is called with
 * the visible part, and first with the whole body. `step(position)` shows another part. `setCount(count)` sets a
 * greater length. If the end was visible, the new end is shown.
 */
export function makePlayer(count, show, unit = "layers") {
  const slider = document.querySelector("#slider");
  const button = document.querySelector("#play");
  let began = null;

  const goTo = (target) => {
    const position = Math.min(count, Math.max(0, Math.round(target)));
    slider.value = position;
    slider.setAttribute("aria-valuetext", `${position} of ${count} ${unit}`);
    show(position);
  };
  const pause = () => {
    began = null;
    button.textContent = "Play";
  };
  const tick = (now) => {
    if (began === null) return;
    const to = began.from + ((now - began.at) / 1000 / PLAY_DURATION_S) * count;
    goTo(to);
    if (to >= count) pause();
    else requestAnimationFrame(tick);
  };
  const play = () => {
    const from = Number(slider.value);
    began = { at: performance.now(), from: from >= count ? 0 : from };
    button.textContent = "Pause";
    requestAnimationFrame(tick);
  };
  const toggle = () => (began === null ? play() : pause());
  const step = (to) => {
    pause();
    goTo(to);
  };
  const setCount = (newCount) => {
    const position = Number(slider.value);
    const isAtEnd = began === null && position === count;
    count = newCount;
    slider.max = count;
    goTo(isAtEnd ? count : position);
  };

  button.addEventListener("click", toggle);
  slider.addEventListener("input", () => step(Number(slider.value)));
  const keys = {
    ArrowLeft: (shift) => step(Number(slider.value) - (shift ? count / 10 : 1)),
    ArrowRight: (shift) => step(Number(slider.value) + (shift ? count / 10 : 1)),
    Home: () => step(0),
    End: () => step(count),
    " ": toggle,
  };
  document.addEventListener("keydown", (event) => {
    const isClick = event.target.matches("button, input[type=checkbox]") && event.key === " ";
    if (isClick || event.ctrlKey || event.altKey || event.metaKey || !keys[event.key]) return;
    event.preventDefault();
    keys[event.key](event.shiftKey);
  });
  slider.max = count;
  goTo(count);
  return { setCount, step };
}
