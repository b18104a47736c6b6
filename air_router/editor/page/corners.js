// The handles of the selected area: corners, the middles of its edges, its radius, the whole.

import { offset } from "/page/map.js";
import { same } from "./store.js";

const L = globalThis.L;
const LEAST_EDGE_PIXELS = 34;
const CROSS =
  '<svg class="icon" viewBox="0 0 24 24"><path d="M12 3v18M3 12h18M9 6l3-3 3 3M9 18l3 3 3-3M6 9l-3 3 3 3M18 9l3 3-3 3"/></svg>';

export class Corners {
  /** @param {any} map @param {import("./store.js").Store} store
   *  @param {import("./selection.js").Selection} selection */
  constructor(map, store, selection) {
    this.map = map;
    this.store = store;
    this.selection = selection;
    this.group = L.layerGroup().addTo(map);
    this.drags = 0; // whose last edit is not answered yet
    selection.addEventListener("change", () => this.show());
    map.on("zoomend", () => this.show());
  }

  /** The selected area. @returns {any} */
  area() {
    const keys = this.selection.now?.area;
    return keys && this.store.state?.areas.find((one) => same(one.keys, keys));
  }

  /** The mission has changed, and the selected area perhaps. */
  update() {
    if (this.area() !== this.shown) this.show();
  }

  /** Make the handles anew, but not under the user's hand. */
  show() {
    if (this.drags > 0) return;
    const area = this.area();
    this.shown = area;
    const focused = this.group.getLayers().find((one) => one.getElement() === document.activeElement);
    this.group.clearLayers();
    if (!area) return;
    for (const ring of area.rings) this.ring(area, ring);
    if (area.circle) this.circle(area, area.circle);
    else if (area.rings.length > 0) this.whole(area, area.rings[0].corners);
    const again = focused && this.group.getLayers().find((one) => one.handle === focused.handle);
    again?.getElement().focus({ preventScroll: true });
  }

  /** @param {any} area @param {{keys: any[], corners: number[][]}} ring */
  ring(area, ring) {
    ring.corners.forEach((at, index) => {
      const keys = [...ring.keys, index];
      this.corner(area, keys, at, `Corner ${index + 1} of ${area.name}`);
      const next = ring.corners[(index + 1) % ring.corners.length];
      if (this.pixels(at, next) < LEAST_EDGE_PIXELS) return; // no room: zoom in to insert one
      this.middle(ring.keys, index + 1, [(at[0] + next[0]) / 2, (at[1] + next[1]) / 2]);
    });
  }

  /** @param {number[]} a @param {number[]} b @returns {number} */
  pixels(a, b) {
    return this.map.latLngToLayerPoint(a).distanceTo(this.map.latLngToLayerPoint(b));
  }

  /** @param {any} area @param {any[]} keys @param {number[]} at @param {string} title */
  corner(area, keys, at, title) {
    const round = area.circle ? "round" : "";
    const marker = this.handle(at, `corner ${area.fence ? "fence" : ""} ${round}`, 13, title);
    marker.setZIndexOffset(3000);
    marker.handle = JSON.stringify(keys);
    marker.getElement().classList.toggle("selected", this.selection.has(keys));
    marker.getElement().dataset.corner = JSON.stringify(keys);
    const choose = () => this.selection.choose({ sort: "corner", keys, area: area.keys });
    marker.on("click", choose);
    marker.on("contextmenu", () => this.store.edit({ do: "remove", keys }));
    this.drag(marker, (to) => ({ do: "move", keys, to }), choose);
  }

  /** @param {any[]} ringKeys @param {number} index @param {number[]} at */
  middle(ringKeys, index, at) {
    const marker = this.handle(at, "middle", 12, "Insert a corner");
    const insert = (place, gesture) =>
      this.store.edit({ do: "add_corner", keys: ringKeys, index, at: place }, gesture);
    marker.on("click", () => insert(at, null));
    let inserted = false;
    this.drag(marker, (to, gesture) => {
      if (inserted) return { do: "move", keys: [...ringKeys, index], to };
      inserted = true;
      insert(to, gesture);
      return null;
    });
  }

  /** @param {any} area @param {{keys: any[], centre: number[], radius_m: number}} circle */
  circle(area, circle) {
    this.corner(area, circle.keys, circle.centre, `Centre of ${area.name}`);
    const edge = offset(circle.centre, circle.radius_m, 0);
    const marker = this.handle(edge, "corner round", 13, `Radius of ${area.name}`);
    marker.handle = "radius";
    this.drag(marker, (to) => {
      const radius = this.map.distance(circle.centre, to);
      return radius >= 0.1 ? { do: "resize", keys: area.keys, radius_m: radius } : null;
    });
  }

  /** @param {any} area @param {number[][]} corners */
  whole(area, corners) {
    const mean = (axis) => corners.reduce((sum, at) => sum + at[axis], 0) / corners.length;
    const marker = this.handle([mean(0), mean(1)], "whole", 24, `Move ${area.name}`, CROSS);
    const origin = [mean(0), mean(1)];
    this.drag(marker, (to) => ({ do: "shift", keys: area.keys, origin, to }));
  }

  /** @param {number[]} at @param {string} className @param {number} size @param {string} title */
  handle(at, className, size, title, html = "") {
    const icon = L.divIcon({ className, iconSize: [size, size], html });
    const marker = L.marker(at, { icon, draggable: true, autoPan: true, title, zIndexOffset: 2000 });
    this.group.addLayer(marker);
    marker.getElement().setAttribute("aria-label", title);
    return marker;
  }

  /** @param {any} marker @param {(to: number[], gesture: string) => any} editOf may give nothing
   *  @param {() => void} [begun] */
  drag(marker, editOf, begun = () => {}) {
    let gesture = "";
    let last = Promise.resolve(true);
    marker.on("dragstart", () => {
      this.drags += 1;
      gesture = this.store.gesture();
      begun();
    });
    marker.on("drag", () => {
      const { lat, lng } = marker.getLatLng();
      const edit = editOf([lat, lng], gesture);
      if (edit) last = this.store.edit(edit, gesture);
    });
    marker.on("dragend", async () => {
      await last;
      this.drags -= 1;
      this.show();
    });
  }
}
