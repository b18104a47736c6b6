// The page without a mouse.

import { offset } from "/page/map.js";
import { cornersOf } from "./selection.js";
import { same } from "./store.js";

const ARROWS = { ArrowUp: [0, 1], ArrowDown: [0, -1], ArrowLeft: [-1, 0], ArrowRight: [1, 0] };
const ORDER = { PageUp: -1, PageDown: 1 };
const TOOLS = { w: "waypoint", z: "zone", e: "fence", c: "circle", r: "rally", p: "route" };
const ONE_MOVE_MS = 800;

/** @param {{store: import("./store.js").Store, selection: import("./selection.js").Selection,
 *   tools: import("./tools.js").Tools, places: import("./places.js").Places, order: import("./order.js").Order, map: any,
 *   save: () => void, fit: () => void, help: () => void}} page */
export function startKeyboard(page) {
  const { store, selection, tools } = page;
  let gesture = "";
  let lastMs = 0;

  /** @param {KeyboardEvent} event @returns {boolean} whether the key had a meaning */
  function press(event) {
    const key = event.key.toLowerCase();
    if (event.ctrlKey || event.metaKey) return command(key, event.shiftKey);
    if (event.target instanceof HTMLInputElement) return false;
    if (ARROWS[event.key] && selection.now) return nudge(ARROWS[event.key], event);
    if (ORDER[event.key] && selection.now && page.order.step(selection.now.keys, ORDER[event.key])) return true;
    if (event.key === "Delete" || event.key === "Backspace") return remove();
    if (event.key === "Escape") return escape();
    if (event.key === "Enter" && ["zone", "fence"].includes(tools.tool)) {
      tools.finish();
      return true;
    }
    if (event.altKey) return false;
    if (TOOLS[key]) tools.choose(TOOLS[key]);
    else if (key === "f") page.fit();
    else if (key === "n") next(event.shiftKey ? -1 : 1);
    else if (key === "?") page.help();
    else return false;
    return true;
  }

  /** @param {string} key @param {boolean} shift */
  function command(key, shift) {
    if (key === "s") page.save();
    else if (key === "z") store.ask(shift ? "redo" : "undo");
    else if (key === "y") store.ask("redo");
    else return false;
    return true;
  }

  /** @param {number[]} direction @param {KeyboardEvent} event */
  function nudge(direction, event) {
    const metres = event.shiftKey ? 10 : event.altKey ? 0.1 : 1;
    const { sort, keys } = selection.now;
    const by = direction.map((part) => part * metres);
    const now = performance.now();
    if (now - lastMs > ONE_MOVE_MS || sort === "area") gesture = store.gesture();
    lastMs = now;
    const { places, areas } = store.state;
    if (sort === "area") {
      const area = areas.find((one) => same(one.keys, keys));
      const at = cornersOf(area)[0]?.at;
      if (at) store.edit({ do: "shift", keys, origin: at, to: offset(at, ...by) }, gesture);
    } else {
      const all = [...places, ...areas.flatMap(cornersOf)];
      const at = all.find((one) => same(one.keys, keys))?.at;
      if (at) store.edit({ do: "move", keys, to: offset(at, ...by) }, gesture);
    }
    return true;
  }

  function remove() {
    if (!selection.now) return false;
    store.edit({ do: "remove", keys: selection.now.keys });
    return true;
  }

  function escape() {
    if (tools.tool !== "select") tools.choose("select");
    else selection.choose(null);
    return true;
  }

  /** @param {number} step */
  function next(step) {
    const waypoints = store.state.places.filter((place) => place.kind === "waypoint" && place.keys);
    if (!waypoints.length) return;
    const here = waypoints.findIndex((place) => selection.has(place.keys));
    const there = waypoints[(here + step + waypoints.length) % waypoints.length];
    selection.choose({ sort: "place", keys: there.keys, area: null });
    page.map.panInside(there.at, { padding: [80, 80] });
    page.places.focus(there.keys);
  }

  document.addEventListener(
    "keydown",
    (event) => {
      if (document.querySelector("dialog[open]") || !store.state) return;
      if (press(event)) {
        event.preventDefault();
        event.stopPropagation();
      }
    },
    { capture: true },
  );
}
