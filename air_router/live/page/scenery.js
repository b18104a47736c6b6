// What does not move: fences, zones, the graph, waypoints, and what they are called.

import { AirspaceLayer } from "/page/airspace.js";
import { Labels } from "./labels.js";

const L = globalThis.L;

export class Scenery {
  /** @param {any} map */
  constructor(map) {
    this.map = map;
    this.airspace = new AirspaceLayer(map);
    this.still = L.layerGroup().addTo(map);
    this.svg = L.svg({ pane: "graph" });
    this.labels = new Labels(map);
  }

  /** @param {any} scenery as the flight sends it */
  show(scenery) {
    this.airspace.show(scenery.areas);
    this.still.clearLayers();
    const common = { renderer: this.svg, pane: "graph", interactive: false };
    L.polyline(scenery.edges, { ...common, className: "edge" }).addTo(this.still);
    for (const { kind, at } of scenery.places) {
      const radius = kind === "home" ? 7 : 4;
      L.circleMarker(at, { ...common, className: `spot ${kind}`, radius }).addTo(this.still);
    }
    this.labels.show(scenery);
    this.map.options.gridOrigin = scenery.places[0]?.at;
  }
}

/** How far it reaches. @param {any} scenery @returns {any} null for nothing */
export function boundsOf(scenery) {
  const points = scenery.places.map((place) => place.at);
  for (const area of scenery.areas) points.push(...area.outline.flat(2));
  return points.length ? L.latLngBounds(points) : null;
}
