// The page that `growbot view` writes: shows the data in it, and joins to the pictures what is on every page, sides and theme.
//
// The data (`#data`, JSON) are written by growbot-pictures/src/view/: what it is of, the robot's lengths in mm, start and goal, the layers
// of the planned body and of the one as built, and the numbers beside it; or two of these, `compared`, and the numbers of both. Of a growth
// under way, `live`, the layers come later.

import { setHeightColours } from "./colours.js";
import { showLive } from "./live.js";
import { showOne } from "./one.js";
import { showPair } from "./pair.js";

const find = (selector) => document.querySelector(selector);
const data = JSON.parse(find("#data").textContent);
setHeightColours(data.height_colours);
/** None where the browser shows none. */
const show = data.compared ? showPair : data.live ? showLive : showOne;
const pictures = show(data).filter(Boolean);

document.querySelectorAll("[data-look]").forEach((button) => {
  button.addEventListener("click", () => pictures.forEach((picture) => picture.look(button.dataset.look)));
});
joinTheme();

/** Light or dark as the system has it, until the button says otherwise. */
function joinTheme() {
  const system = matchMedia("(prefers-color-scheme: dark)");
  let chosen = null;
  const apply = () => {
    const theme = chosen ?? (system.matches ? "dark" : "light");
    document.documentElement.dataset.theme = theme;
    find("#theme").textContent = theme === "dark" ? "Light" : "Dark";
    pictures.forEach((picture) => picture.paint());
  };
  system.addEventListener("change", apply);
  find("#theme").addEventListener("click", () => {
    chosen = document.documentElement.dataset.theme === "dark" ? "light" : "dark";
    apply();
  });
  apply();
}
