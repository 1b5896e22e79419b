// Question before a command that destroys something. It leaves the header uncovered, so that the emergency stop works
// while it is open.

/** Time before the answer can be given, so that a double click on the button before it does not answer. */
const ARM_MS = 1_000;
const byId = (id) => document.getElementById(id);

/** Asks whether to do what `action` names. Returns a promise of true or false. */
export function ask(title, text, action) {
  const dialog = byId("question");
  if (dialog.open) return Promise.resolve(false);
  const [confirm, keep] = [byId("question-confirm"), byId("question-keep")];
  const previousFocus = document.activeElement;
  [byId("question-title").textContent, byId("question-text").textContent] = [title, text];
  [confirm.textContent, confirm.disabled] = [action, true];
  const timer = setTimeout(() => { confirm.disabled = false; }, ARM_MS);
  byId("shade").hidden = false;
  document.querySelector("main").inert = true;
  byId("body").inert = true;
  // A modal dialog would block the emergency stop.
  dialog.show();
  keep.focus();
  return new Promise((resolve) => {
    const listening = new AbortController();
    const answer = (isConfirmed) => {
      listening.abort();
      clearTimeout(timer);
      dialog.close();
      byId("shade").hidden = true;
      document.querySelector("main").inert = false;
      byId("body").inert = false;
      previousFocus?.focus();
      resolve(isConfirmed);
    };
    const { signal } = listening;
    confirm.addEventListener("click", () => answer(true), { signal });
    keep.addEventListener("click", () => answer(false), { signal });
    document.addEventListener("keydown", (event) => {
      if (event.key !== "Escape") return;
      event.stopPropagation();
      answer(false);
    }, { signal, capture: true });
  });
}
