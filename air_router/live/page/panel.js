// The bar and the panel: what the flight does, and its robots; of several flights, the chosen one.

import { byId, element, setText } from "/page/element.js";
import { colour } from "/page/theme.js";
import { age } from "./robots.js";

const MOST_SAMPLES = 180;
const CHART = [60, 20];
const WEAKEST_DBM = -100;
const STRONGEST_DBM = -40;

export class Panel {
  /** @param {(robot: string) => void} seek is told whom to seek */
  constructor(seek) {
    this.seek = seek;
    this.heard = {};
    this.links = {};
    this.rows = new Map();
  }

  /** @param {any} vehicle */
  showVehicle(vehicle) {
    setText(byId("state"), vehicle.state);
    byId("state").className = `chip ${vehicle.state}`;
    setText(byId("what"), vehicle.robot ? `${vehicle.what}: ${vehicle.robot}` : vehicle.what);
    setText(byId("left"), vehicle.left_s === null ? "" : `${Math.ceil(vehicle.left_s)} s`);
    setText(byId("facts"), facts(vehicle));
    const title = `${vehicle.state} · ${vehicle.name}`;
    if (document.title !== title) document.title = title;
    const robots = new Set([...vehicle.robots, ...Object.keys(this.heard), ...Object.keys(this.links)]);
    for (const name of robots) this.row(name, vehicle.robots.includes(name));
  }

  /** @param {{name: string, age_s: number}[]} robots */
  showRobots(robots) {
    this.heard = Object.fromEntries(robots.map((robot) => [robot.name, robot]));
    for (const [name, row] of this.rows) {
      const robot = this.heard[name];
      const share = this.links[name]?.map_share;
      const map = share ? `, map ${percent(share)}` : "";
      setText(row.age, (robot ? `seen ${age(robot.age_s)} ago` : "never heard") + map);
    }
  }

  /** @param {any[]} links */
  showLinks(links) {
    this.links = Object.fromEntries(links.map((link) => [link.peer, link]));
    for (const [name, row] of this.rows) {
      const link = this.links[name];
      row.signal.classList.toggle("heard", Boolean(link) && link.rssi_dbm !== null);
      row.signal.classList.toggle("lit", Boolean(link?.lit));
      row.signal.title = link && link.rssi_dbm !== null ? `${link.rssi_dbm} dBm` : "not heard by radio";
    }
  }

  /** Signals over the last minutes; ticks below: data crossed.
   *  @param {Record<string, [number | null, number][]>} charts */
  showCharts(charts) {
    for (const [name, samples] of Object.entries(charts)) {
      const canvas = this.rows.get(name)?.chart;
      if (!canvas) continue;
      const [width, height] = CHART;
      const context = canvas.getContext("2d");
      const step = width / MOST_SAMPLES;
      context.clearRect(0, 0, width, height);
      context.fillStyle = colour("route");
      samples.forEach(([, lit], index) => lit && context.fillRect(index * step, height - 3, Math.max(step, 1), 3));
      context.fillStyle = colour("good");
      samples.forEach(([signal], index) => {
        if (signal === null) return;
        const share = Math.min(Math.max((signal - WEAKEST_DBM) / (STRONGEST_DBM - WEAKEST_DBM), 0.05), 1);
        context.fillRect(index * step, (height - 4) * (1 - share), Math.max(step, 1), (height - 4) * share);
      });
    }
  }

  /** @param {string} name @param {boolean} sought whether the mission seeks it */
  row(name, sought) {
    if (this.rows.has(name)) return;
    const signal = element("span", { className: "signal" });
    const old = element("small");
    const chart = element("canvas", { width: CHART[0], height: CHART[1] });
    chart.setAttribute("aria-label", `Signal of ${name} over the last minutes`);
    const item = element("li", {}, signal, element("span", { textContent: name }), chart, old);
    item.dataset.robot = name;
    if (sought) {
      const button = element("button", { textContent: "Seek" });
      button.setAttribute("aria-label", `Seek ${name} now`);
      button.addEventListener("click", () => this.seek(name));
      item.append(button);
    }
    byId("robots").append(item);
    this.rows.set(name, { signal, chart, age: old });
  }

  /** Tell of another flight. @param {import("./flight.js").Flight} flight */
  show(flight) {
    this.rows.clear();
    byId("robots").replaceChildren();
    this.heard = {};
    this.links = {};
    byId("state").className = "chip";
    const nothing = { state: "…", what: "", left: "", facts: `${flight.name} ${flight.why}` };
    for (const [id, text] of Object.entries(nothing)) setText(byId(id), text);
    if (!flight.vehicle) return;
    this.showVehicle(flight.vehicle);
    this.showLinks(flight.links);
    this.showRobots(flight.robots);
    this.showCharts(flight.charts);
  }
}

/** @param {any} vehicle @returns {string} */
function facts(vehicle) {
  const parts = [vehicle.name];
  if (vehicle.at) {
    parts.push(`${vehicle.altitude_m} m`, `${vehicle.speed_m_s} m/s`, `${vehicle.mode} mode`);
    if (vehicle.battery !== null) {
      const need = vehicle.need_home === null ? "" : ` (home takes ${percent(vehicle.need_home)})`;
      parts.push(`battery ${percent(vehicle.battery)}${need}`);
    }
    if (!vehicle.fix) parts.push("no GPS fix");
    if (vehicle.wind) parts.push(`wind ${vehicle.wind}`);
    if (vehicle.home_moved) parts.push("home moved");
  }
  parts.push(`${vehicle.waypoints_left} waypoints left`);
  return parts.join(" · ");
}

/** @param {number} share @returns {string} */
function percent(share) {
  return `${Math.round(share * 100)}%`;
}
