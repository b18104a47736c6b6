// Light or dark: as the system is set, until the user chooses.

import { byId } from "./element.js";

const KEY = "air-router theme";

/** @returns {string | null} what was chosen before, if the browser remembers */
function chosen() {
  try {
    return localStorage.getItem(KEY);
  } catch {
    return null;
  }
}

/** Follow the system's colours, or those that are chosen with the page's button "theme". */
export function startTheme() {
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const follow = () => apply(chosen() ?? (dark.matches ? "dark" : "light"));
  dark.addEventListener("change", follow);
  byId("theme").addEventListener("click", switchTheme);
  follow();
}

/** Choose the other one. */
function switchTheme() {
  const next = document.documentElement.dataset.theme === "dark" ? "light" : "dark";
  try {
    localStorage.setItem(KEY, next);
  } catch {
    // for this page only, then
  }
  apply(next);
}

/** @param {string} name of a colour, without dashes
 *  @returns {string} its present value, for what is drawn on a canvas */
export function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

/** @param {string} theme */
function apply(theme) {
  document.documentElement.dataset.theme = theme;
  document.dispatchEvent(new CustomEvent("theme"));
}
