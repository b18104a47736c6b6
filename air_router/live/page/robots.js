// The robots where they were last heard to be: of several flights, the one tells that heard of them last.

import { element, setText } from "/page/element.js";
import { line } from "./vehicle.js";

const L = globalThis.L;
const OLD_S = 60;

/** @typedef {{name: string, at: number[], age_s: number, way: number[][]}} Told what a flight tells of a robot */

export class Robots {
  /** @param {any} map @param {any} svg */
  constructor(map, svg) {
    this.map = map;
    this.svg = svg;
    /** @type {Map<string, {marker: any, label: any, way: any, at: number[], drawn: string}>} with the way that is drawn */
    this.shown = new Map();
  }

  /** @param {import("./flight.js").Flight[]} flights */
  show(flights) {
    const newest = newestOf(flights);
    for (const [name, robot] of this.shown) if (!newest.has(name)) this.remove(name, robot);
    const seekers = new Map(flights.map((flight) => [flight.vehicle?.robot, flight]));
    for (const told of newest.values()) {
      const robot = this.shown.get(told.name) ?? this.add(told);
      robot.at = told.at;
      robot.marker.setLatLng(told.at);
      const way = JSON.stringify(told.way);
      if (way !== robot.drawn) robot.way.setLatLngs(told.way);
      robot.drawn = way;
      const { classList, style } = robot.marker.getElement();
      const seeker = seekers.get(told.name);
      classList.toggle("old", told.age_s > OLD_S);
      classList.toggle("sought", Boolean(seeker));
      style.setProperty("--uav", seeker?.colour ? `var(--${seeker.colour})` : "");
      setText(robot.label, `${told.name} · ${age(told.age_s)}`);
    }
  }

  /** @param {Told} told */
  add(told) {
    const label = element("span");
    const icon = L.divIcon({ className: "robot", iconSize: [15, 15], html: label });
    const marker = L.marker(told.at, { icon, interactive: false, title: told.name }).addTo(this.map);
    marker.getElement().dataset.robot = told.name;
    const robot = { marker, label, way: line(this.map, this.svg, "way"), at: told.at, drawn: "" };
    this.shown.set(told.name, robot);
    return robot;
  }

  /** @param {string} name @param {{marker: any, way: any}} robot */
  remove(name, { marker, way }) {
    marker.remove();
    way.remove();
    this.shown.delete(name);
  }
}

/** What is newest of each robot; a UAV that tells of itself is no robot.
 *  @param {import("./flight.js").Flight[]} flights @returns {Map<string, Told>} */
function newestOf(flights) {
  const newest = new Map();
  for (const flight of flights) {
    for (const told of flight.robots) {
      const age_s = told.age_s + flight.goneForS;
      if (age_s < (newest.get(told.name)?.age_s ?? Infinity)) newest.set(told.name, { ...told, age_s });
    }
  }
  for (const flight of flights) if (flight.connected && flight.vehicle?.at) newest.delete(flight.name);
  return newest;
}

/** @param {number} seconds @returns {string} */
export function age(seconds) {
  return seconds < 90 ? `${Math.round(seconds)} s` : `${Math.round(seconds / 60)} min`;
}
