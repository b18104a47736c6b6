// The selection: one place, one corner or one area, by its keys.

import { same } from "./store.js";

/** @typedef {{sort: "place" | "corner" | "area", keys: import("./store.js").Keys,
 *   area: import("./store.js").Keys | null}} Selected */

export class Selection extends EventTarget {
  constructor() {
    super();
    /** @type {Selected | null} */
    this.now = null;
  }

  /** @param {Selected | null} next */
  choose(next) {
    if (same(this.now?.keys, next?.keys) && this.now?.sort === next?.sort) return;
    this.now = next;
    this.dispatchEvent(new Event("change"));
  }

  /** @param {import("./store.js").Keys | null} keys @returns {boolean} */
  has(keys) {
    return keys !== null && same(this.now?.keys, keys);
  }

  /** Choose whatever has these keys. @param {import("./store.js").State} state
   *  @param {import("./store.js").Keys} keys */
  find(state, keys) {
    if (state.places.some((place) => same(place.keys, keys))) {
      this.choose({ sort: "place", keys, area: null });
      return;
    }
    for (const area of state.areas) {
      if (same(area.keys, keys)) this.choose({ sort: "area", keys, area: keys });
      else if (cornersOf(area).some((corner) => same(corner.keys, keys))) {
        this.choose({ sort: "corner", keys, area: area.keys });
      }
    }
  }

  /** Deselect what no longer exists. @param {import("./store.js").State} state */
  check(state) {
    if (!this.now) return;
    const { sort, keys } = this.now;
    const known =
      sort === "place"
        ? state.places.some((place) => same(place.keys, keys))
        : state.areas.some((area) =>
            sort === "area" ? same(area.keys, keys) : cornersOf(area).some((c) => same(c.keys, keys)),
          );
    if (!known) this.choose(null);
  }
}

/** @param {import("/page/airspace.js").Area} area
 *  @returns {{keys: import("./store.js").Keys, at: number[]}[]} what can be dragged of it */
export function cornersOf(area) {
  const corners = area.rings.flatMap((ring) =>
    ring.corners.map((at, index) => ({ keys: [...ring.keys, index], at })),
  );
  return area.circle ? [...corners, { keys: area.circle.keys, at: area.circle.centre }] : corners;
}
