// The bar and the panel: what the flight does, and its robots; of several flights, the chosen one.

import { byId, element, setText } from "/page/element.js";
import { colour } from "/page/theme.js";
import { signalText, strength } from "./links.js";
import { age } from "./robots.js";

const MOST_SAMPLES = 180;
const CHART = [60, 20];
const LEAST = 0.05;

export class Panel {
  /** @param {(robot: string) => void} seek requests the search for a robot */
  constructor(seek) {
    this.seek = seek;
    this.reports = {};
    this.links = {};
    this.rows = new Map();
    /** @type {Map<string, HTMLElement>} */
    this.instruments = new Map();
  }

  /** @param {any} vehicle */
  showVehicle(vehicle) {
    setText(byId("state"), vehicle.state);
    byId("state").className = `chip ${vehicle.state}`;
    setText(byId("what"), vehicle.robot ? `${vehicle.what}: ${vehicle.robot}` : vehicle.what);
    setText(byId("left"), vehicle.left_s === null ? "" : `${Math.ceil(vehicle.left_s)} s`);
    setText(byId("facts"), facts(vehicle));
    for (const [name, value] of instruments(vehicle)) this.instrument(name, value);
    const alarmed = document.body.classList.contains("alarmed") ? "ALARM · " : "";
    const title = `${alarmed}${vehicle.state} · ${vehicle.name}`;
    if (document.title !== title) document.title = title;
    const robots = new Set([...vehicle.robots, ...Object.keys(this.reports), ...Object.keys(this.links)]);
    for (const name of robots) this.row(name, vehicle.robots.includes(name));
  }

  /** @param {{name: string, age_s: number}[]} robots */
  showRobots(robots) {
    this.reports = Object.fromEntries(robots.map((robot) => [robot.name, robot]));
    this.showAges();
  }

  /** @param {any[]} links */
  showLinks(links) {
    this.links = Object.fromEntries(links.map((link) => [link.peer, link]));
    for (const [name, row] of this.rows) {
      const link = this.links[name];
      row.signal.classList.toggle("received", Boolean(link) && link.signal !== null);
      row.signal.classList.toggle("lit", Boolean(link?.glows));
      row.signal.title = (link && signalText(link)) || "no radio signal";
    }
    this.showAges();
  }

  /** The age of each robot's position, and its share of the map. */
  showAges() {
    for (const [name, row] of this.rows) {
      const robot = this.reports[name];
      const share = this.links[name]?.map_share;
      const map = share ? `\nmap ${percent(share)}` : "";
      setText(row.age, (robot ? `${age(robot.age_s)} ago` : "no position received") + map);
    }
  }

  /** Signal by link: a column for each UAV, a row for each of its peers.
   *  @param {import("./flight.js").Flight[]} flights */
  showMatrix(flights) {
    if (!byId("links").open) return;
    const peers = [...new Set(flights.flatMap((flight) => flight.links.map((link) => link.peer)))].sort();
    const head = flights.map((flight) => element("th", { className: flight.colour, textContent: flight.name }));
    const rows = peers.map((peer) => element("tr", {}, element("th", { textContent: peer }),
      ...flights.map((flight) => cell(flight.links.find((link) => link.peer === peer), flights.length > 1))));
    byId("links").querySelector("table").replaceChildren(
      element("thead", {}, element("tr", {}, element("th"), ...head)), element("tbody", {}, ...rows));
  }

  /** Signals over the last minutes; ticks below: data crossed.
   *  @param {{rows: any[][], playback: {now_s: number} | null}} flight */
  showCharts({ rows, playback }) {
    const end = playback ? rows.findLastIndex((row) => row[0] <= playback.now_s) + 1 : rows.length;
    const last = rows.slice(Math.max(end - MOST_SAMPLES, 0), end);
    for (const [name, { chart }] of this.rows) {
      const [width, height] = CHART;
      const context = chart.getContext("2d");
      const step = width / MOST_SAMPLES;
      context.clearRect(0, 0, width, height);
      last.forEach(([, , , , , links], index) => {
        const [signal, lit, , unit] = links[name] ?? [null, 0];
        context.fillStyle = colour("route");
        if (lit) context.fillRect(index * step, height - 3, Math.max(step, 1), 3);
        if (signal === null) return;
        const share = Math.max(strength(signal, unit), LEAST);
        context.fillStyle = colour("good");
        context.fillRect(index * step, (height - 4) * (1 - share), Math.max(step, 1), (height - 4) * share);
      });
    }
  }

  /** @param {string} name @param {string} value "" where it is unknown */
  instrument(name, value) {
    const shown = this.instruments.get(name) ?? element("span");
    if (!this.instruments.has(name)) {
      byId("vehicle").append(element("div", {}, element("small", { textContent: name }), shown));
      this.instruments.set(name, shown);
    }
    setText(shown, value || "–");
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

  /** Show another flight. @param {import("./flight.js").Flight} flight */
  show(flight) {
    this.rows.clear();
    byId("robots").replaceChildren();
    this.reports = {};
    this.links = {};
    byId("state").className = "chip";
    const nothing = { state: "…", what: "", left: "", facts: `${flight.name} ${flight.why}` };
    for (const [id, text] of Object.entries(nothing)) setText(byId(id), text);
    if (!flight.vehicle) return;
    this.showVehicle(flight.vehicle);
    this.showLinks(flight.links);
    this.showRobots(flight.robots);
    this.showCharts(flight);
  }
}

/** @param {any} vehicle @returns {[string, string][]} */
function instruments(vehicle) {
  const known = (value, unit) => (value == null ? "" : `${value}${unit}`);
  const heading = vehicle.heading_deg == null ? "" : `${Math.round(vehicle.heading_deg)}°`;
  const satellites = vehicle.fix ? known(vehicle.satellites, " sats") || "fix" : "no fix";
  return [
    ["heading", heading],
    ["home", known(vehicle.home_m, " m")],
    ["GPS", vehicle.at ? satellites : ""],
    ["voltage", known(vehicle.voltage_v?.toFixed(1), " V")],
  ];
}

/** @param {any} link @param {boolean} brief @returns {HTMLElement} a cell of the matrix; empty without a link */
function cell(link, brief) {
  if (!link) return element("td");
  const signal = signalText(link) || "–";
  const synced = link.synced_ago_s === null ? "never" : `${age(link.synced_ago_s)} ago`;
  const data = `${(link.bytes / 1000).toFixed(0)} kB`;
  const title = `signal, last sync; ${data} in ${link.syncs} syncs`;
  return element("td", { title, textContent: [signal, synced, ...(brief ? [] : [data])].join(" · ") });
}

/** @param {any} vehicle @returns {string} */
function facts(vehicle) {
  const parts = [vehicle.name];
  if (vehicle.waiting) parts.push(`waiting: ${vehicle.waiting}`);
  if (vehicle.at) {
    const flying = [`${vehicle.altitude_m} m`, `${vehicle.speed_m_s} m/s`];
    parts.push(...(vehicle.in_air ? flying : ["on the ground"]), `${vehicle.mode} mode`);
    if (vehicle.battery !== null) {
      const need = vehicle.need_home === null ? "" : ` (home takes ${percent(vehicle.need_home)})`;
      parts.push(`battery ${percent(vehicle.battery)}${need}`);
    }
    if (!vehicle.fix) parts.push("no GPS fix");
    if (vehicle.wind) parts.push(`wind ${vehicle.wind}`);
    if (vehicle.home_moved) parts.push("home moved");
  }
  const left = vehicle.waypoints_left;
  parts.push(`${left} waypoint${left === 1 ? "" : "s"} left`);
  return parts.join(" · ");
}

/** @param {number} share @returns {string} */
function percent(share) {
  return `${Math.round(share * 100)}%`;
}
