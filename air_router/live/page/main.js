// The live page: puts its parts together.

import { Layout } from "/page/layout.js";
import { byId } from "/page/element.js";
import { MISSION, addLegend } from "/page/legend.js";
import { addBackdrop, createMap } from "/page/map.js";
import { startTheme } from "/page/theme.js";
import { Alarms } from "./alarms.js";
import { Flight } from "./flight.js";
import { Grounds } from "./ground.js";
import { Log } from "./log.js";
import { Panel } from "./panel.js";
import { Robots } from "./robots.js";
import { Scenery } from "./scenery.js";
import { Tabs } from "./tabs.js";
import { Timeline } from "./timeline.js";
import { Verbs } from "./verbs.js";

const L = globalThis.L;
const TOAST_MS = 8000;
const RETRY_MS = 2000;

/** @type {import("/page/legend.js").Sign[]} */
const SIGNS = [
  ...MISSION,
  ["arrow", "sign", "UAV"],
  ["line", "track", "flown track"],
  ["line", "route", "planned route"],
  ["area", "sign robot-sign", "robot, last reported position"],
  ["line", "way", "path that a robot announced"],
  ["line", "link", "radio link"],
  ["line", "link lit", "link transferring data"],
];

startTheme();
addLegend(byId("legend"), SIGNS);
const map = createMap(byId("map"));
map.setView([0, 0], 2, { animate: false });
const svg = L.svg({ pane: "route" });
const scenery = new Scenery(map);
const log = new Log();
const alarms = new Alarms();
const panel = new Panel((robot) => verbs.seek(robot));
const verbs = new Verbs(map, () => chosen, say);
const timeline = new Timeline(() => chosen);
let following = false;
let toastTimer = 0;
let isDue = false;

const shown = await listing();
const isOne = shown.flights.length === 1;
const layout = new Layout(map, fit);
const watcher = { received, due, pressed: (flight) => verbs.choosing || choose(flight), connected };
const grounds = new Grounds(map);
/** @type {Flight[]} */
const flights = shown.flights.map(
  (where, index) => new Flight(map, svg, grounds, where, isOne ? 0 : index + 1, watcher),
);
let chosen = flights[0];
const robots = new Robots(map, svg);
const tabs = isOne ? null : new Tabs(flights, choose);
document.body.classList.toggle("several", !isOne);
if (shown.backdrop) addBackdrop(map, shown.backdrop);
if (!isOne) choose(chosen);

/** The flights that the server lists. @returns {Promise<{flights: {name: string, socket: string}[], backdrop?: any}>} */
async function listing() {
  for (;;) {
    try {
      const answer = await fetch("/flights");
      if (answer.ok) return await answer.json();
    } catch {
      // the server is not reachable
    }
    byId("offline").hidden = false;
    await new Promise((resolve) => setTimeout(resolve, RETRY_MS));
  }
}

/** Show what a flight does not draw itself. @param {Flight} flight @param {any} message */
function received(flight, message) {
  if (message.type === "log") log.add(flight, message);
  if (message.type === "alarms") alarms.show(flight, message);
  if (message.type === "welcome") welcomed(flight, message);
  if (message.type === "scenery" && !flight.seen && !layout.touched) fit();
  flight.seen ||= message.type === "scenery";
  if (flight !== chosen) return;
  if (message.type === "scenery") scenery.show(message);
  if (message.type === "vehicle") panel.showVehicle(message);
  if (message.type === "vehicle") verbs.allow(flight);
  if (message.type === "vehicle" && following && message.at) map.panTo(message.at, { animate: false });
  if (message.type === "robots") panel.showRobots(message.robots);
  if (message.type === "links") panel.showLinks(message.links);
  if (["rows", "record", "playback"].includes(message.type)) {
    panel.showCharts(flight);
    panel.showMatrix(flights);
    timeline.show();
  }
}

/** @param {Flight} flight @param {{backdrop: any}} welcome */
function welcomed(flight, { backdrop }) {
  log.forget(flight);
  alarms.forget(flight);
  // A page for several has a picture of its own, or none.
  if (shown.backdrop === undefined && backdrop) addBackdrop(map, backdrop);
}

/** Something is to be shown with the next frame. */
function due() {
  if (!isDue) requestAnimationFrame(show);
  isDue = true;
}

function show() {
  isDue = false;
  for (const flight of flights) flight.catchUp();
  robots.show(flights);
  const vehicles = new Map(flights.map((flight) => [flight.name, flight.shape.at]));
  const placeOf = (peer) => vehicles.get(peer) ?? robots.shown.get(peer)?.at;
  for (const flight of flights) flight.lines.draw(flight.shape.at, placeOf);
  tabs?.show(chosen);
}

/** A flight has connected, or was lost. @param {Flight} flight */
function connected(flight) {
  if (!isOne && flight === chosen && !flight.vehicle) panel.show(flight);
  if (flight === chosen) verbs.allow(flight);
  const lost = flights.filter((flight) => (isOne ? !flight.connected : flight.isLost));
  byId("offline").hidden = lost.length === 0;
  if (!isOne && lost.length) {
    const who = lost.map((flight) => `${flight.name} ${flight.why}`).join("; ");
    byId("offline").textContent = `${who}. Reconnecting …`;
  }
  due();
}

/** Show one flight in the panel, with its scenery; requests go to it. @param {Flight} flight */
function choose(flight) {
  if (verbs.choosing && flight !== chosen) verbs.stop(); // the points were for another one
  chosen = flight;
  for (const each of flights) each.choose(each === flight);
  tabs?.show(flight);
  tabs?.reveal(flight);
  if (following && flight.shape.at) map.panTo(flight.shape.at, { animate: false });
  if (flight.scenery) scenery.show(flight.scenery);
  panel.show(flight);
  verbs.allow(flight);
  timeline.show();
}

/** Show all missions. */
function fit() {
  const bounds = flights.reduce((all, flight) => (flight.bounds ? all.extend(flight.bounds) : all), L.latLngBounds([]));
  if (!bounds.isValid()) return;
  follow(false);
  layout.show(bounds.pad(0.02));
}

/** @param {boolean} on */
function follow(on) {
  following = on;
  byId("follow").setAttribute("aria-pressed", String(on));
}

/** @param {string} text @param {boolean} [stays] */
function say(text, stays = false) {
  clearTimeout(toastTimer);
  byId("hint").hidden = !text;
  byId("hint").textContent = text;
  if (text && !stays) toastTimer = setTimeout(() => say(""), TOAST_MS);
}

map.on("dragstart", () => follow(false));
byId("fit").addEventListener("click", () => {
  layout.touched = false;
  fit();
});
byId("follow").addEventListener("click", () => {
  layout.touched = true;
  follow(!following);
});
byId("hold-all").addEventListener("click", () => verbs.holdAll(flights));
document.addEventListener("keydown", (event) => {
  if (event.key.toLowerCase() === "f" && !event.ctrlKey && !document.querySelector("dialog[open]")) fit();
});
