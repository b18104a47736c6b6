// How the edit page is used.

import { byId, element } from "/page/element.js";
import { open } from "/page/question.js";

const KEYS = [
  ["Drag", "move waypoints, home and rally points; the corners, the radius or the whole of a selected zone"],
  ["Right click, Del", "remove a waypoint, a corner or a zone"],
  ["Dashed dots", "insert a corner: click or drag them"],
  ["Arrow keys", "move the selection by 1 m; Shift: 10 m, Alt: 10 cm"],
  ["Tab, Enter", "move between places; select"],
  ["N, Shift+N", "next and previous waypoint"],
  ["PgUp, PgDn", "the selected waypoint earlier or later in the order; in the list, drag it"],
  ["W Z C E R P", "waypoints, zone, circle, fence, rally point, route"],
  ["Ctrl+Z, Ctrl+Shift+Z", "undo and redo"],
  ["Ctrl+S", "save the file; comments are kept"],
  ["Blue, amber, red legs", "direct; with a detour; blocked"],
  ["Solid, dashed borders", "required clearance; clearance plus tracking margin"],
  ["F, Esc", "fit to view; deselect or cancel"],
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
