// The route graph, the operator's legs, and a requested route.

import { colour } from "/page/theme.js";

const L = globalThis.L;

export class Legs {
  /** @param {any} map */
  constructor(map) {
    const svg = L.svg({ pane: "legs" });
    const line = (className, pane, renderer) =>
      L.polyline([], { className, pane, renderer, interactive: false }).addTo(map);
    this.edges = L.polyline([], {
      pane: "graph",
      renderer: L.canvas({ pane: "graph", padding: 0.5 }),
      interactive: false,
      weight: 1,
      opacity: 0.4,
    }).addTo(map);
    this.detours = line("detour", "legs", svg);
    this.ways = {
      straight: line("leg straight", "legs", svg),
      around: line("leg around", "legs", svg),
      blocked: line("leg blocked", "legs", svg),
    };
    this.route = line("route", "route", L.svg({ pane: "route" }));
    this.paint();
    document.addEventListener("theme", () => this.paint());
  }

  /** Canvas does not know style sheets. */
  paint() {
    this.edges.setStyle({ color: colour("graph") });
  }

  /** @param {import("./store.js").State} state */
  show(state) {
    const nodes = new Map(state.places.filter((p) => p.node !== null).map((p) => [p.node, p.at]));
    const edges = state.graph.edges.map(([a, b]) => [nodes.get(a), nodes.get(b)]);
    this.edges.setLatLngs(edges.filter(([a, b]) => a && b));
    this.detours.setLatLngs(state.graph.detours);
    for (const [way, line] of Object.entries(this.ways)) {
      line.setLatLngs(state.legs.filter((leg) => leg.way === way).map((leg) => leg.points));
    }
  }
}
