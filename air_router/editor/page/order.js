// The order of the waypoints: one is dragged in the list, or moved by a key or a button; all are reversed.

import { byId, element } from "/page/element.js";
import { same } from "./store.js";

const EDGE_PIXELS = 36; // so near to the panel's edge it scrolls while a waypoint is dragged
const SCROLL_PIXELS = 10;

export class Order {
  /** @param {import("./store.js").Store} store @param {import("./selection.js").Selection} selection */
  constructor(store, selection) {
    this.store = store;
    this.selection = selection;
    byId("reverse").addEventListener("click", () => store.edit({ do: "reverse" }));
  }

  /** Those that can be moved, in their order. @returns {import("./store.js").Place[]} */
  get waypoints() {
    return this.store.state?.places.filter(({ kind, keys }) => kind === "waypoint" && keys) ?? [];
  }

  /** @param {import("./store.js").Keys | null | undefined} keys @returns {number} -1 for anything else */
  indexOf(keys) {
    return keys ? this.waypoints.findIndex((place) => same(place.keys, keys)) : -1;
  }

  /** Move a waypoint earlier (-1) or later (1). @param {import("./store.js").Keys} keys @param {number} step
   *  @returns {boolean} whether it is one */
  step(keys, step) {
    const at = this.indexOf(keys);
    if (at >= 0) this.put(keys, at + step);
    return at >= 0;
  }

  /** Move a waypoint to a place in the order; it stays selected. @param {import("./store.js").Keys} keys @param {number} index */
  async put(keys, index) {
    const slot = this.waypoints[index]?.keys;
    if (!slot || same(slot, keys)) return;
    if (await this.store.edit({ do: "reorder", keys, index })) this.selection.choose({ sort: "place", keys: slot, area: null });
  }

  /** What a row of the list is dragged by, with a finger too. @param {any} row @param {import("./store.js").Keys} keys
   *  @returns {HTMLElement} */
  grip(row, keys) {
    const grip = element("span", { className: "grip", textContent: "⠿", title: "Drag to another place in the order" });
    grip.setAttribute("aria-hidden", "true"); // keys and buttons do the same
    grip.addEventListener("pointerdown", (event) => {
      event.preventDefault();
      grip.setPointerCapture(event.pointerId);
      this.drag(grip, row, keys);
    });
    return grip;
  }

  /** @param {HTMLElement} grip @param {any} row @param {import("./store.js").Keys} keys */
  drag(grip, row, keys) {
    const others = [...byId("list").querySelectorAll("li.waypoint")].filter((one) => one !== row);
    const done = new AbortController();
    let index = this.indexOf(keys);
    row.classList.add("dragged");

    /** @param {number} to */
    const mark = (to) => {
      index = to;
      others.forEach((one, number) => {
        one.classList.toggle("before", number === to);
        one.classList.toggle("after", number === to - 1 && to === others.length);
      });
    };
    /** @param {boolean} dropped */
    const end = (dropped) => {
      done.abort();
      row.classList.remove("dragged");
      for (const one of others) one.classList.remove("before", "after");
      if (dropped && row.isConnected) this.put(keys, index);
    };
    const { signal } = done;
    grip.addEventListener("pointermove", ({ clientY }) => {
      const { top, bottom } = byId("panel").getBoundingClientRect();
      if (clientY > bottom - EDGE_PIXELS) byId("panel").scrollBy(0, SCROLL_PIXELS);
      if (clientY < top + EDGE_PIXELS) byId("panel").scrollBy(0, -SCROLL_PIXELS);
      mark(others.filter((one) => middle(one) < clientY).length);
    }, { signal });
    grip.addEventListener("pointerup", () => end(true), { signal });
    grip.addEventListener("pointercancel", () => end(false), { signal });
    document.addEventListener("keydown", (event) => {
      if (event.key !== "Escape") return;
      event.stopPropagation();
      end(false);
    }, { signal, capture: true });
  }
}

/** @param {Element} row @returns {number} */
function middle(row) {
  const { top, bottom } = row.getBoundingClientRect();
  return (top + bottom) / 2;
}
