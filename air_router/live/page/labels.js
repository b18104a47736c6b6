// Names of zones and numbers of waypoints, as announcements have them: as many as there is room for.

import { element } from "/page/element.js";

const L = globalThis.L;
const LEAST_ZONE = 12; // pixels; a smaller zone has no name
const MOST_LETTERS = 24;
const GAP = 2; // pixels between two labels, and between a label and its place
const CELL = 64; // pixels
const AROUND = 0.3; // of the view: so far beyond it labels are ready for a drag

/** @typedef {{text: string, className: string, at: any, bounds: any, radius: number}} Label of a place or a zone;
 *    `at`: a place in it, `bounds`: its box in degrees, null for a place
 *  @typedef {[number, number, number, number]} Box left, top, right and bottom in pixels */

/** Boxes that are taken, in cells of a grid, so that each new one is compared with few. */
class Taken {
  constructor() {
    /** @type {Map<string, Box[]>} */
    this.cells = new Map();
  }

  /** @param {Box} box @returns {string[]} */
  cellsOf([left, top, right, bottom]) {
    const cells = [];
    for (let x = Math.floor(left / CELL); x <= Math.floor(right / CELL); x += 1) {
      for (let y = Math.floor(top / CELL); y <= Math.floor(bottom / CELL); y += 1) cells.push(`${x},${y}`);
    }
    return cells;
  }

  /** @param {Box} box */
  isFree(box) {
    const [left, top, right, bottom] = box;
    return this.cellsOf(box).every((cell) => (this.cells.get(cell) ?? []).every(
      (other) => left > other[2] || right < other[0] || top > other[3] || bottom < other[1]));
  }

  /** @param {Box} box */
  add(box) {
    for (const cell of this.cellsOf(box)) this.cells.set(cell, [...(this.cells.get(cell) ?? []), box]);
  }
}

export class Labels {
  /** @param {any} map */
  constructor(map) {
    this.map = map;
    this.pane = map.getPane("labels");
    /** The most important first. @type {Label[]} */
    this.labels = [];
    /** Width and height of what was shown before. @type {Map<string, number[]>} */
    this.sizes = new Map();
    this.covered = null;
    this.origin = null;
    map.on("zoomstart", () => this.pane.replaceChildren());
    map.on("zoomend viewreset resize", () => this.place());
    map.on("moveend", () => this.isCovered() || this.place());
  }

  /** @param {any} scenery as the flight sends it */
  show({ areas, places }) {
    const zones = areas.filter(({ label }) => label).map(({ name, label, outline }) => ({
      text: name.length > MOST_LETTERS ? `${name.slice(0, MOST_LETTERS - 1)}…` : name,
      className: "map-label zone-name",
      at: L.latLng(label),
      bounds: L.latLngBounds(outline.flat(2)),
      radius: 0,
    }));
    const size = ({ bounds }) => (bounds.getNorth() - bounds.getSouth()) * (bounds.getEast() - bounds.getWest());
    const spots = places.map(({ kind, node, at }) => ({
      text: kind === "waypoint" ? String(node) : "",
      className: "map-label waypoint-number",
      at: L.latLng(at),
      bounds: null,
      radius: kind === "home" ? 8 : 5,
    }));
    this.labels = [...zones.sort((one, other) => size(other) - size(one)), ...spots];
    this.place();
  }

  isCovered() {
    return this.covered?.contains(this.map.getBounds()) && this.origin.equals(this.map.getPixelOrigin());
  }

  /** Put each label where it covers neither another one nor a spot, or leave it out. */
  place() {
    const { map } = this;
    this.covered = map.getBounds().pad(AROUND);
    this.origin = map.getPixelOrigin();
    const seen = this.labels.filter(({ at }) => this.covered.contains(at));
    this.measure(seen);
    const taken = new Taken();
    for (const { at, bounds, radius } of seen) if (!bounds) taken.add(around(map.latLngToLayerPoint(at), radius));
    const shown = [];
    for (const label of seen.filter(({ text }) => text)) {
      const [width, height] = this.sizes.get(key(label));
      const box = this.candidates(label, width, height).find((one) => taken.isFree(one));
      if (!box) continue;
      taken.add([box[0] - GAP, box[1] - GAP, box[2] + GAP, box[3] + GAP]);
      shown.push(made(label, box[0], box[1]));
    }
    this.pane.replaceChildren(...shown);
  }

  /** How large labels are that were not shown yet. @param {Label[]} labels */
  measure(labels) {
    const fresh = new Map(labels.filter((label) => !this.sizes.has(key(label))).map((label) => [key(label), made(label, 0, 0)]));
    this.pane.append(...fresh.values());
    for (const [name, one] of fresh) this.sizes.set(name, [one.offsetWidth, one.offsetHeight]);
  }

  /** Where a label may stand, the best first. @param {Label} label @param {number} width @param {number} height
   *  @returns {Box[]} */
  candidates({ at, bounds, radius }, width, height) {
    const { x, y } = this.map.latLngToLayerPoint(at);
    const box = (left, top) => /** @type {Box} */ ([left, top, left + width, top + height]);
    if (!bounds) {
      const away = radius + GAP;
      const [middle, centre] = [y - height / 2, x - width / 2];
      return [box(x + away, middle), box(x - away - width, middle), box(centre, y - away - height), box(centre, y + away)];
    }
    const [west, east] = [bounds.getNorthWest(), bounds.getSouthEast()].map((corner) => this.map.latLngToLayerPoint(corner));
    if (Math.max(east.x - west.x, east.y - west.y) < LEAST_ZONE) return [];
    const centre = (west.x + east.x - width) / 2;
    return [box(x - width / 2, y - height / 2), box(centre, west.y - GAP - height), box(centre, east.y + GAP)];
  }
}

/** @param {{x: number, y: number}} at @param {number} radius @returns {Box} */
function around({ x, y }, radius) {
  return [x - radius, y - radius, x + radius, y + radius];
}

/** @param {Label} label @returns {string} */
function key({ text, className }) {
  return `${className} ${text}`;
}

/** @param {Label} label @param {number} left @param {number} top in pixels @returns {HTMLElement} */
function made({ text, className }, left, top) {
  const shown = element("span", { className, textContent: text });
  shown.style.transform = `translate(${Math.round(left)}px, ${Math.round(top)}px)`;
  return shown;
}
