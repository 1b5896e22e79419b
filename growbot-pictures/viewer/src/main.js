// The page that `growbot view` writes. It shows the data, and connects the buttons that every page has (viewpoint and
// theme) to the pictures.
//
// growbot-pictures/src/view/ writes the data (`#data`, JSON): a description, the robot's lengths in mm, start and goal,
// the layers of the planned body and of the one as built, and the numbers next to it. For two bodies, `compared` has
// two of these objects, and the numbers are those of both. For a running growth, `live` is set and the layers follow
// later.

import { setHeightColours } from "./colours.js";
import { isEmbedded } from "./embedding.js";
import { showLive } from "./live.js";
import { showBody } from "./one.js";
import { showPair } from "./pair.js";

const find = (selector) => document.querySelector(selector);
const data = JSON.parse(find("#data").textContent);
setHeightColours(data.height_colours);
// Before the pictures get their sizes.
if (isEmbedded) embed();
/** Shows the data and returns the pictures. A picture is null if the browser cannot draw it. */
const show = data.compared ? showPair : data.live ? showLive : showBody;
const pictures = show(data).filter(Boolean);

document.querySelectorAll("[data-viewpoint]").forEach((button) => {
  button.addEventListener("click", () => {
    setFollowing(false);
    pictures.forEach((picture) => picture.setViewpoint(button.dataset.viewpoint));
  });
});
find("#follow").addEventListener("click", ({ currentTarget }) => setFollowing(currentTarget.ariaPressed !== "true"));
initTheme();

/** Shows only the picture and its controls, because the page around this one has the rest. */
function embed() {
  document.documentElement.dataset.embedded = "";
  find("[data-viewpoint=corner]").textContent = "Fit";
  find("#follow").hidden = false;
}

/** Keeps the tip in the middle of the pictures, or not. */
function setFollowing(isFollowing) {
  find("#follow").ariaPressed = String(isFollowing);
  pictures.forEach((picture) => picture.setFollowing(isFollowing));
}

/** Sets the theme to that of the system, until the user clicks the button. */
function initTheme() {
  const system = matchMedia("(prefers-color-scheme: dark)");
  let userChoice = null;
  const apply = () => {
    const theme = userChoice ?? (system.matches ? "dark" : "light");
    document.documentElement.dataset.theme = theme;
    find("#theme").textContent = theme === "dark" ? "Light" : "Dark";
    pictures.forEach((picture) => picture.applyTheme());
  };
  system.addEventListener("change", apply);
  find("#theme").addEventListener("click", () => {
    userChoice = document.documentElement.dataset.theme === "dark" ? "light" : "dark";
    apply();
  });
  apply();
}
