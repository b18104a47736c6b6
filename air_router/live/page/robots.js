// The robots at their last reported positions; of several flights, the newest report counts.

import { element, setText } from "/page/element.js";
import { line } from "./vehicle.js";

const L = globalThis.L;
const OLD_S = 60;

/** @typedef {{name: string, at: number[], age_s: number, way: number[][]}} RobotReport what a flight reports of a robot */

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
    for (const report of newest.values()) {
      const robot = this.shown.get(report.name) ?? this.add(report);
      robot.at = report.at;
      robot.marker.setLatLng(report.at);
      const way = JSON.stringify(report.way);
      if (way !== robot.drawn) robot.way.setLatLngs(report.way);
      robot.drawn = way;
      const { classList, style } = robot.marker.getElement();
      const seeker = seekers.get(report.name);
      classList.toggle("old", report.age_s > OLD_S);
      classList.toggle("sought", Boolean(seeker));
      style.setProperty("--uav", seeker?.colour ? `var(--${seeker.colour})` : "");
      setText(robot.label, `${report.name} · ${age(report.age_s)}`);
    }
  }

  /** @param {RobotReport} report */
  add(report) {
    const label = element("span");
    const icon = L.divIcon({ className: "robot", iconSize: [15, 15], html: label });
    const marker = L.marker(report.at, { icon, interactive: false, title: report.name }).addTo(this.map);
    marker.getElement().dataset.robot = report.name;
    const robot = { marker, label, way: line(this.map, this.svg, "way"), at: report.at, drawn: "" };
    this.shown.set(report.name, robot);
    return robot;
  }

  /** @param {string} name @param {{marker: any, way: any}} robot */
  remove(name, { marker, way }) {
    marker.remove();
    way.remove();
    this.shown.delete(name);
  }
}

/** The newest report of each robot; a UAV with a page of its own is not a robot.
 *  @param {import("./flight.js").Flight[]} flights @returns {Map<string, RobotReport>} */
function newestOf(flights) {
  const newest = new Map();
  for (const flight of flights) {
    for (const report of flight.robots) {
      const age_s = report.age_s + flight.silentForS;
      if (age_s < (newest.get(report.name)?.age_s ?? Infinity)) newest.set(report.name, { ...report, age_s });
    }
  }
  for (const flight of flights) if (flight.connected && flight.vehicle?.at) newest.delete(flight.name);
  return newest;
}

/** @param {number} seconds @returns {string} */
export function age(seconds) {
  return seconds < 90 ? `${Math.round(seconds)} s` : `${Math.round(seconds / 60)} min`;
}
