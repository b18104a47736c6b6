// The edit page: puts its parts together.

import { AirspaceLayer } from "/page/airspace.js";
import { Layout } from "/page/layout.js";
import { byId, element } from "/page/element.js";
import { MISSION, addLegend } from "/page/legend.js";
import { addBackdrop, createMap } from "/page/map.js";
import { question } from "/page/question.js";
import { startTheme } from "/page/theme.js";
import { Corners } from "./corners.js";
import { help } from "./dialogs.js";
import { Inspector } from "./inspector.js";
import { startKeyboard } from "./keyboard.js";
import { Legs } from "./legs.js";
import { Order } from "./order.js";
import { Panel } from "./panel.js";
import { Places } from "./places.js";
import { Selection } from "./selection.js";
import { Store, same } from "./store.js";
import { Tools } from "./tools.js";

const L = globalThis.L;
const TOAST_MS = 6000;

/** @type {import("/page/legend.js").Sign[]} */
const SIGNS = [
  ...MISSION,
  ["line", "leg", "direct leg"],
  ["line", "leg around", "leg with a detour"],
  ["line", "leg blocked", "blocked leg"],
  ["line", "route", "requested route"],
];

startTheme();
addLegend(byId("legend"), SIGNS);
const map = createMap(byId("map"));
let fitted = false;
const layout = new Layout(map, () => fitted && fit());
const store = new Store();
const selection = new Selection();
const legs = new Legs(map);
const tools = new Tools(map, store, selection, legs);
const places = new Places(map, store, selection, tools);
const airspace = new AirspaceLayer(map, pressed);
const corners = new Corners(map, store, selection);
const order = new Order(store, selection);
const inspector = new Inspector(store, selection, order);
const panel = new Panel(store, visit, order);
let toastTimer = 0;

/** A click on an area. @param {import("/page/airspace.js").Area} area @param {any} event */
function pressed(area, event) {
  if (tools.tool !== "select") return; // the map takes it
  L.DomEvent.stop(event);
  if (!area.keys) return;
  if (event.type === "contextmenu") {
    if (area.removable) store.edit({ do: "remove", keys: area.keys });
  } else {
    selection.choose({ sort: "area", keys: area.keys, area: area.keys });
  }
}

/** Show the whole mission. */
function fit() {
  const { state } = store;
  if (!state) return;
  const points = state.places.map((place) => place.at);
  for (const area of state.areas) {
    points.push(...area.rings.flatMap((ring) => ring.corners));
    if (area.circle) {
      points.push(...boundsOf(area.circle));
    }
  }
  if (points.length) layout.show(L.latLngBounds(points).pad(0.02));
}

/** @param {{centre: number[], radius_m: number}} circle @returns {any[]} two corners */
function boundsOf({ centre, radius_m: radius }) {
  const box = L.latLng(centre).toBounds(2 * radius);
  return [box.getSouthWest(), box.getNorthEast()];
}

/** Show something and select it.
 *  @param {import("./store.js").Keys | null} keys @param {number[][]} at */
function visit(keys, at) {
  if (at.length) {
    const zoom = at.length === 1 ? Math.max(map.getZoom(), 19) : 21;
    layout.show(L.latLngBounds(at).pad(0.3), { maxZoom: zoom });
  }
  if (keys && store.state) selection.find(store.state, keys);
}

/** @param {string} text @param {{label: string, act: () => void} | null} [action] */
function say(text, action = null) {
  clearTimeout(toastTimer);
  const hint = byId("hint");
  hint.hidden = !text;
  hint.replaceChildren(text);
  if (action) {
    const button = element("button", { textContent: action.label });
    button.addEventListener("click", () => {
      hint.hidden = true;
      action.act();
    });
    hint.append(button);
  }
}

/** A message that goes away. @param {string} text @param {any} [action] */
function toast(text, action) {
  say(text, action);
  toastTimer = setTimeout(() => tools.choose(tools.tool), TOAST_MS);
}

/** @param {import("./store.js").State} state */
function show(state) {
  selection.check(state);
  map.options.gridOrigin = state.places.find((place) => place.kind === "home")?.at;
  if (!fitted) {
    fitted = state.places.length + state.areas.length > 0;
    map.setView([0, 0], 2, { animate: false });
    fit();
  }
  const { settings } = state;
  document.title = `${state.dirty ? "• " : ""}${settings.name}`;
  byId("name").textContent = settings.name;
  byId("file").textContent = state.file;
  byId("file").classList.toggle("dirty", state.dirty);
  byId("facts").textContent = facts(state);
  byId("save").disabled = !state.dirty;
  button("undo", state.undo, "Undo", "Ctrl+Z");
  button("redo", state.redo, "Redo", "Ctrl+Shift+Z");
  airspace.show(state.areas);
  legs.show(state);
  places.show(state.places);
  corners.update();
  inspector.show();
  panel.show(state);
  markAreas();
  if (tools.chosen.length === 2) tools.showRoute();
}

/** @param {import("./store.js").State} state @returns {string} */
function facts({ settings, places: all }) {
  const count = all.filter((place) => place.kind === "waypoint").length;
  const time = settings.time_s === null ? "" : `, about ${duration(settings.time_s)}`;
  const waypoints = count === 1 ? "1 waypoint" : `${count} waypoints`;
  const km = (settings.length_m / 1000).toFixed(2);
  return `· ${waypoints}, ${km} km to the last one${time}`;
}

/** @param {number} seconds @returns {string} */
function duration(seconds) {
  const minutes = Math.ceil(seconds / 60);
  return minutes < 120 ? `${minutes} min` : `${(minutes / 60).toFixed(1)} h`;
}

/** @param {string} id @param {string | null} what @param {string} name @param {string} key */
function button(id, what, name, key) {
  byId(id).disabled = what === null;
  byId(id).title = `${name}${what ? ` ${what}` : ""} (${key})`;
}

function markAreas() {
  for (const { shape, area } of airspace.drawn.values()) {
    const chosen = area.keys !== null && same(selection.now?.area, area.keys);
    shape.getElement()?.classList.toggle("selected", chosen);
  }
}

async function save(options = {}) {
  try {
    await store.link.ask({ ask: "save", ...options });
    toast(store.state?.problems.some((one) => !one.note) ? "Saved as a draft with problems." : "Saved.");
  } catch (error) {
    await unsaved(error, options);
  }
}

/** Load the file again. */
async function load() {
  if (store.state?.dirty) {
    const choices = [{ label: "Keep editing", value: "" }, { label: "Load the file", value: "load", main: true }];
    const text = "changes since the last save will be lost.";
    if (!(await question("Load the file?", text, choices))) return;
  }
  await store.ask("reload");
}

/** @param {any} error @param {object} options */
async function unsaved(error, options) {
  if (error.kind === "unconfirmed") {
    const choices = [{ label: "Keep editing", value: "" }, { label: "Save the draft", value: "save", main: true }];
    if (await question("Save with problems?", error.message, choices)) {
      await save({ ...options, confirmed: true });
    }
  } else if (error.kind === "changed") {
    const choices = [
      { label: "Cancel", value: "" },
      { label: "Load the file, discard my changes", value: "reload" },
      { label: "Overwrite the file", value: "overwrite", main: true },
    ];
    const choice = await question("The file has changed", error.message, choices);
    if (choice === "overwrite") await save({ ...options, overwrite: true });
    if (choice === "reload") await store.ask("reload");
  } else {
    toast(error.message);
  }
}

store.addEventListener("state", (event) => show(/** @type {any} */ (event).detail));
store.addEventListener("setting", (event) => {
  const { backdrop } = /** @type {any} */ (event).detail;
  if (backdrop) addBackdrop(map, backdrop);
});
store.addEventListener("disk", (event) => {
  if (!(/** @type {any} */ (event).detail.changed)) return;
  const reload = { label: "Load the file", act: () => load() };
  say("Another program has changed the file.", reload);
});
store.addEventListener("refused", (event) => {
  const { detail } = /** @type {any} */ (event);
  if (detail.kind !== "offline") toast(detail.message);
  if (store.state) places.show(store.state.places);
  corners.show();
});
store.addEventListener("connected", (event) => {
  byId("offline").hidden = /** @type {any} */ (event).detail;
});
tools.addEventListener("hint", (event) => say(/** @type {any} */ (event).detail));
tools.addEventListener("chosen", () => places.mark());
selection.addEventListener("change", markAreas);
byId("undo").addEventListener("click", () => store.ask("undo"));
byId("redo").addEventListener("click", () => store.ask("redo"));
byId("help").addEventListener("click", help);
byId("fit").addEventListener("click", fit);
byId("save").addEventListener("click", () => save());
byId("parts").addEventListener("toggle", () => store.state && panel.list(store.state));
startKeyboard({ store, selection, tools, places, order, map, save, fit, help });
