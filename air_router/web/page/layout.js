// Panels and toolbars over the map stand in a grid; its cell "free" is what it leaves free of the map.

import { byId } from "./element.js";

const MARGIN_PIXELS = 20;

export class Layout {
  /** @param {any} map @param {() => void} changed is called when more or less of the map is free */
  constructor(map, changed) {
    this.map = map;
    this.touched = false;
    byId("fold").addEventListener("click", () => this.fold());
    for (const kind of ["pointerdown", "wheel", "keydown"]) {
      map.getContainer().addEventListener(kind, () => (this.touched = true), { passive: true });
    }
    new ResizeObserver(() => {
      this.place();
      if (!this.touched) changed();
    }).observe(byId("free"));
  }

  /** Leaflet's own controls, too, stand where the map is free. */
  place() {
    const { left, top, right, bottom } = this.free;
    const controls = this.map.getContainer().querySelector(".leaflet-control-container");
    controls.style.inset = `${top}px ${right}px ${bottom}px ${left}px`;
    this.map.invalidateSize({ animate: false });
  }

  /** How much is covered at each side, in pixels. */
  get free() {
    const { left, top, right, bottom } = byId("free").getBoundingClientRect();
    return { left, top, right: innerWidth - right, bottom: innerHeight - bottom };
  }

  /** Bring a part of the world to where it can be seen. @param {any} bounds @param {object} [options] of Leaflet */
  show(bounds, options = {}) {
    const { left, top, right, bottom } = this.free;
    const margin = Math.min(MARGIN_PIXELS, (innerWidth - left - right) / 8, (innerHeight - top - bottom) / 8);
    this.map.fitBounds(bounds, {
      animate: false, // while one zoom moves, Leaflet takes no other
      maxZoom: 21,
      paddingTopLeft: [left + margin, top + margin],
      paddingBottomRight: [right + margin, bottom + margin],
      ...options,
    });
  }

  /** Fold away all but the essentials, or unfold. */
  fold() {
    const folded = document.body.classList.toggle("folded");
    byId("fold").setAttribute("aria-pressed", String(folded));
  }
}
