// The controls of time: slider, play button and keys.

/** Time in which a whole body grows, s. */
const SECONDS = 12;

/**
 * Connects the controls of the page to a body of `count` layers, or of another `unit`. `show(place)` is called with the
 * visible part, and first with the whole body. `lengthen(count)` sets a greater length. If the end was visible, the new
 * end is shown.
 */
export function makePlayer(count, show, unit = "layers") {
  const slider = document.querySelector("#slider");
  const button = document.querySelector("#play");
  let began = null;

  const go = (to) => {
    const place = Math.min(count, Math.max(0, Math.round(to)));
    slider.value = place;
    slider.setAttribute("aria-valuetext", `${place} of ${count} ${unit}`);
    show(place);
  };
  const pause = () => {
    began = null;
    button.textContent = "Play";
  };
  const tick = (now) => {
    if (began === null) return;
    const to = began.from + ((now - began.at) / 1000 / SECONDS) * count;
    go(to);
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
    go(to);
  };
  const lengthen = (longer) => {
    const place = Number(slider.value);
    const following = began === null && place === count;
    count = longer;
    slider.max = count;
    go(following ? count : place);
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
    const typing = event.target.matches("button, input[type=checkbox]") && event.key === " ";
    if (typing || event.ctrlKey || event.altKey || event.metaKey || !keys[event.key]) return;
    event.preventDefault();
    keys[event.key](event.shiftKey);
  });
  slider.max = count;
  go(count);
  return { lengthen };
}
