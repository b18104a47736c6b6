// One UAV on the map: where it is and heads to, its track, the route that is left.

import { element, setText } from "/page/element.js";

const L = globalThis.L;
const ARROW = '<svg viewBox="0 0 38 38"><path d="M19 3 30 33 19 27 8 33Z" fill="currentColor" stroke="var(--card)"'
  + ' stroke-width="2" stroke-linejoin="round"/></svg>';

/** A line of what moves. @param {any} map @param {any} svg its renderer @param {string} className */
export function line(map, svg, className) {
  const options = { renderer: svg, pane: "route", interactive: false, className, smoothFactor: 0.5 };
  return L.polyline([], options).addTo(map);
}

export class Vehicle {
  /** @param {any} map @param {any} svg @param {string} colour the class of its colour; "" if it is the only one
   *  @param {() => void} pressed is called for clicks, if there are other flights */
  constructor(map, svg, colour, pressed) {
    this.map = map;
    this.colour = colour;
    this.pressed = pressed;
    this.track = line(map, svg, `track ${colour}`);
    this.route = line(map, svg, `route ${colour}`);
    /** @type {number[][]} */
    this.flown = [];
    this.marker = null;
    this.label = element("span");
    /** @type {number[] | null} */
    this.at = null;
    this.chosen = true;
  }

  /** @param {{from: number, points: number[][]}} piece */
  addTrack({ from, points }) {
    if (from > this.flown.length) return; // what lies between comes with the next welcome
    this.flown.splice(from, this.flown.length, ...points);
    this.track.setLatLngs(this.flown);
  }

  /** @param {any} vehicle as the flight sends it */
  show(vehicle) {
    this.at = vehicle.at;
    this.route.setLatLngs(vehicle.route);
    if (!vehicle.at) return;
    this.marker ??= this.mark(vehicle.at);
    this.marker.setLatLng(vehicle.at);
    const shown = this.marker.getElement();
    shown.firstChild.style.transform = `rotate(${Number(vehicle.heading_deg ?? 0)}deg)`;
    shown.classList.toggle("lost", !vehicle.in_charge);
    if (this.colour) setText(this.label, vehicle.name);
  }

  /** @param {number[]} at */
  mark(at) {
    const options = { className: `vehicle ${this.colour}`, iconSize: [38, 38], html: ARROW };
    const more = { interactive: Boolean(this.colour), bubblingMouseEvents: true, keyboard: false };
    const marker = L.marker(at, { icon: L.divIcon(options), zIndexOffset: 5000, ...more }).addTo(this.map);
    if (this.colour) marker.getElement().append(this.label);
    marker.on("click", () => this.pressed());
    this.marker = marker;
    this.choose(this.chosen);
    return marker;
  }

  /** @param {boolean} chosen whether the panel shows it */
  choose(chosen) {
    this.chosen = chosen;
    for (const part of [this.marker, this.track, this.route]) part?.getElement()?.classList.toggle("other", !chosen);
    this.marker?.setZIndexOffset(chosen ? 6000 : 5000);
  }

  /** Nothing was flown. */
  forget() {
    this.addTrack({ from: 0, points: [] });
  }
}
