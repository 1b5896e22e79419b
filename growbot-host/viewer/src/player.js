// The time: slider, play button and keys.

/** All layers are grown in so many seconds, however many they are. */
const SECONDS = 12;

/** Joins the controls of the page; `show(layers)` is called with how much of the body there is, at once with all of it. */
export function makePlayer(count, show) {
  const slider = document.querySelector("#slider");
  const button = document.querySelector("#play");
  slider.max = count;
  let began = null;

  const go = (layers) => {
    const place = Math.min(count, Math.max(0, Math.round(layers)));
    slider.value = place;
    slider.setAttribute("aria-valuetext", `${place} of ${count} layers`);
    show(place);
  };
  const pause = () => {
    began = null;
    button.textContent = "Play";
  };
  const tick = (now) => {
    if (began === null) return;
    const layers = began.layers + ((now - began.at) / 1000 / SECONDS) * count;
    go(layers);
    if (layers >= count) pause();
    else requestAnimationFrame(tick);
  };
  const play = () => {
    const from = Number(slider.value);
    began = { at: performance.now(), layers: from >= count ? 0 : from };
    button.textContent = "Pause";
    requestAnimationFrame(tick);
  };
  const toggle = () => (began === null ? play() : pause());
  const step = (layers) => {
    pause();
    go(layers);
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
  go(count);
}
