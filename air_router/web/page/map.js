// A calm map without tiles: paper, a grid of round metres, a scale, perhaps a picture below.

import { Grid } from "./grid.js";

const L = globalThis.L;

/** Panes from below to above, with their height. */
const PANES = { backdrop: 150, grid: 160, buffers: 360, graph: 380, areas: 400, legs: 420, route: 440 };

/** @param {HTMLElement} element @returns {any} a Leaflet map */
export function createMap(element) {
  L.Projection.SphericalMercator.MAX_LATITUDE = 89.99; // no tiles, so no square world to stay in
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
  map.getPane("grid").style.pointerEvents = "none";
  map.getPane("buffers").style.pointerEvents = "none";
  map.getPane("graph").style.pointerEvents = "none";
  L.control.zoom({ position: "bottomright" }).addTo(map);
  L.control.scale({ position: "bottomright", imperial: false, maxWidth: 140 }).addTo(map);
  new Grid({ pane: "grid" }).addTo(map);
  return map;
}

/** Lay a picture under the map.
 *  @param {any} map
 *  @param {{bounds: number[] | null, world: number[] | null}} place in degrees, see the program */
export function addBackdrop(map, place) {
  const picture = new Image();
  picture.onload = () => {
    let [south, west, north, east] = place.bounds ?? [0, 0, 0, 0];
    if (place.world) {
      const [perColumn, perRow, longitude, latitude] = place.world;
      west = longitude - perColumn / 2;
      north = latitude - perRow / 2;
      east = west + perColumn * picture.naturalWidth;
      south = north + perRow * picture.naturalHeight;
    }
    L.imageOverlay(picture, [[south, west], [north, east]], { pane: "backdrop" }).addTo(map);
  };
  picture.src = "/backdrop";
}

/** @param {number[]} from @param {number} eastM @param {number} northM @returns {number[]} */
export function offset(from, eastM, northM) {
  const perDegree = 111_320;
  const latitude = from[0] + northM / perDegree;
  return [latitude, from[1] + eastM / (perDegree * Math.cos((from[0] * Math.PI) / 180))];
}
