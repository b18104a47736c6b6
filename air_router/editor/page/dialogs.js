// How the edit page is used.

import { byId, element } from "/page/element.js";
import { open } from "/page/question.js";

const KEYS = [
  ["Drag", "moves waypoints, home, rally points; of a selected zone its corners, radius or the whole"],
  ["Right click, Del", "removes a waypoint, a corner or a zone"],
  ["Dashed dots", "insert a corner: click or drag them"],
  ["Arrow keys", "move what is selected by 1 m; Shift: 10 m, Alt: 10 cm"],
  ["Tab, Enter", "go from place to place, and select"],
  ["N, Shift+N", "next and previous waypoint"],
  ["PgUp, PgDn", "the selected waypoint earlier or later in the order; in the list, drag it"],
  ["W Z C E R P", "waypoints, zone, circle, fence, rally point, route"],
  ["Ctrl+Z, Ctrl+Shift+Z", "undo and redo"],
  ["Ctrl+S", "saves the file; comments stay"],
  ["Blue, amber, red legs", "flown straight; flown around what is in the way; cannot be flown"],
  ["Solid, dashed borders", "the clearance; clearance and tracking margin, which routes keep"],
  ["F, Esc", "show everything; let go"],
];

/** Say how the page is used. @returns {Promise<string>} */
export function help() {
  const list = element("dl");
  for (const [key, what] of KEYS) {
    list.append(element("dt", { textContent: key }), element("dd", { textContent: what }));
  }
  const close = element("button", { textContent: "Close", className: "main" });
  close.addEventListener("click", () => byId("question").close(""));
  return open("Editing", [list], [close]);
}
