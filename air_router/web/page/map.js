// A calm map: paper, a grid of round metres, a scale, perhaps a picture below.

import { byId, element } from "./element.js";
import { colour } from "./theme.js";

const L = globalThis.L;

/** Panes from below to above, with their height. */
const PANES = { backdrop: 150, grid: 160, buffers: 360, graph: 380, areas: 400, legs: 420, route: 440, labels: 450 };

/** Of the grid: its lines are at least so far apart, and one of these. */
const LEAST_PIXELS = 70;
const STEPS_M = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10000, 50000, 100000];

/** Lines every 10, 50, 100 ... metres, counted from a fixed place, drawn on one canvas. */
const Grid = L.Layer.extend({
  onAdd(map) {
    this._map = map;
    this._canvas = L.DomUtil.create("canvas", "leaflet-layer", map.getPane("grid"));
    map.on("moveend zoomend resize viewreset", () => this.draw());
    document.addEventListener("theme", () => this.draw());
  },

  /** The lines cover more than the view, so that a drag does not show their ends. */
  draw() {
    const map = this._map;
    const size = map.getSize();
    const pad = size.multiplyBy(0.5).round();
    const whole = size.add(pad.multiplyBy(2));
    const ratio = globalThis.devicePixelRatio || 1;
    const canvas = this._canvas;
    canvas.width = whole.x * ratio;
    canvas.height = whole.y * ratio;
    canvas.style.width = `${whole.x}px`;
    canvas.style.height = `${whole.y}px`;
    const corner = map.containerPointToLayerPoint(pad.multiplyBy(-1));
    L.DomUtil.setPosition(canvas, corner);
    const centre = map.getCenter();
    const here = [centre.lat, centre.lng];
    const metre = map.latLngToLayerPoint(offset(here, 1000, 0)).x - map.latLngToLayerPoint(here).x;
    const pixelsPerM = metre / 1000;
    const stepM = STEPS_M.find((step) => step * pixelsPerM >= LEAST_PIXELS);
    if (!stepM || !Number.isFinite(pixelsPerM)) return;
    const origin = map.options.gridOrigin ?? here;
    const start = map.latLngToLayerPoint(origin).subtract(corner);
    const step = stepM * pixelsPerM;
    const context = canvas.getContext("2d");
    context.scale(ratio, ratio);
    context.strokeStyle = colour("grid");
    context.lineWidth = 1;
    context.beginPath();
    for (let x = start.x % step; x < whole.x; x += step) {
      context.moveTo(Math.round(x) + 0.5, 0);
      context.lineTo(Math.round(x) + 0.5, whole.y);
    }
    for (let y = start.y % step; y < whole.y; y += step) {
      context.moveTo(0, Math.round(y) + 0.5);
      context.lineTo(whole.x, Math.round(y) + 0.5);
    }
    context.stroke();
  },
});

/** @param {HTMLElement} element @returns {any} a Leaflet map; where the pointer is stands in the page's "pointer" */
export function createMap(element) {
  L.Projection.SphericalMercator.MAX_LATITUDE = 89.99; // missions lie beyond the square world of tiles
  const map = L.map(element, {
    zoomControl: false,
    zoomSnap: 0.1,
    zoomDelta: 0.5,
    wheelPxPerZoomLevel: 90,
    maxZoom: 24,
    minZoom: 2,
    doubleClickZoom: false,
    attributionControl: false,
  });
  for (const [name, height] of Object.entries(PANES)) {
    map.createPane(name).style.zIndex = String(height);
  }
  for (const name of ["grid", "buffers", "graph", "labels"]) map.getPane(name).style.pointerEvents = "none";
  L.control.zoom({ position: "bottomright" }).addTo(map);
  L.control.scale({ position: "bottomright", imperial: false, maxWidth: 140 }).addTo(map);
  new Grid({ pane: "grid" }).addTo(map);
  map.on("mousemove", ({ latlng }) => {
    byId("pointer").textContent = `${latlng.lat.toFixed(7)}, ${latlng.wrap().lng.toFixed(7)}`;
  });
  return map;
}

/** @typedef {{address: string, bounds: number[] | null, lowest: number, highest: number, attribution: string}} Tiles */

/** What lies under a map, as text, and how to take it away. @type {WeakMap<any, {is: string, remove: () => void}>} */
const laid = new WeakMap();

/** Lay tiles under the map, instead of others.
 *  @param {any} map @param {Tiles} tiles see the program */
export function addBackdrop(map, tiles) {
  const is = JSON.stringify(tiles);
  if (laid.get(map)?.is === is) return;
  laid.get(map)?.remove();
  laid.set(map, { is, remove: addTiles(map, tiles) });
}

/** Of the coarsest tiles one more level is drawn; for a whole country there would be too many.
 *  @param {any} map @param {Tiles} tiles @returns {() => void} */
function addTiles(map, { address, bounds, lowest, highest, attribution }) {
  const from = lowest - 1.5; // the map's zoom is no whole number
  const layer = L.tileLayer(address, {
    pane: "backdrop",
    zIndex: -1, // below what robots have painted, whichever comes first
    bounds: bounds && [bounds.slice(0, 2), bounds.slice(2)],
    minZoom: from,
    maxZoom: map.options.maxZoom,
    minNativeZoom: lowest,
    maxNativeZoom: highest,
    errorTileUrl: L.Util.emptyImageUrl,
  }).addTo(map);
  const control = L.control.attribution({ prefix: false }).addTo(map);
  if (attribution) control.addAttribution(element("span", { textContent: attribution }).innerHTML);
  const update = () => control.setPrefix(map.getZoom() < from && "zoom in for imagery");
  map.on("zoomend", update);
  update();
  map.getContainer().classList.add("pictured");
  return () => {
    map.getContainer().classList.remove("pictured");
    map.off("zoomend", update);
    for (const part of [layer, control]) part.remove();
  };
}

/** @param {number[]} from @param {number} eastM @param {number} northM @returns {number[]} */
export function offset(from, eastM, northM) {
  const perDegree = 111_320;
  const latitude = from[0] + northM / perDegree;
  return [latitude, from[1] + eastM / (perDegree * Math.cos((from[0] * Math.PI) / 180))];
}
