// The route graph, the operator's legs, and a requested route.

import { colour } from "/page/theme.js";

const L = globalThis.L;

export class Legs {
  /** @param {any} map */
  constructor(map) {
    this.map = map;
    this.svg = L.svg({ pane: "legs" });
    this.canvas = L.canvas({ pane: "graph", padding: 0.5 });
    /** Of each node: where it is, the nodes above it that it is joined to, and the line to them.
     *  @type {{at: number[], others: number[], line: any}[]} */
    this.nodes = [];
    /** The lines of detours and legs, by style and places. @type {Map<string, any>} */
    this.lines = new Map();
    this.route = this.line([], "route", "route", L.svg({ pane: "route" }));
    this.paint();
    document.addEventListener("theme", () => this.paint());
  }

  /** Canvas does not know style sheets. */
  paint() {
    this.colour = colour("graph");
    for (const { line } of this.nodes) line.setStyle({ color: this.colour });
  }

  /** Each has a line of its own: what does not change is not drawn again.
   *  @param {import("./store.js").State} state */
  show(state) {
    this.edges(state);
    const old = this.lines;
    this.lines = new Map();
    const keep = (points, className) => {
      const key = `${className} ${points}`;
      if (this.lines.has(key)) return;
      this.lines.set(key, old.get(key) ?? this.line(points, className, "legs", this.svg));
      old.delete(key);
    };
    for (const way of state.detours) keep(way, "detour");
    for (const leg of state.legs) keep(leg.points, `leg ${leg.way}`);
    for (const line of old.values()) line.remove();
  }

  /** A line for each node, so that one that moves costs only its neighbours.
   *  @param {import("./store.js").State} state */
  edges({ places, edges }) {
    const at = new Map(places.map((place) => [place.node, place.at]));
    const moved = new Set(edges.map((_, node) => node).filter((node) => differ(at.get(node), this.nodes[node]?.at)));
    this.nodes.splice(edges.length).forEach(({ line }) => line.remove());
    edges.forEach((others, node) => {
      const old = this.nodes[node];
      if (old?.others === others && ![node, ...others].some((one) => moved.has(one))) return;
      const style = { weight: 1, opacity: 0.4, color: this.colour };
      const line = old?.line ?? this.line([], "", "graph", this.canvas, style);
      const from = at.get(node);
      this.nodes[node] = { at: from, others, line };
      line.setLatLngs(from ? others.filter((one) => at.get(one)).map((one) => [from, at.get(one)]) : []);
    });
  }

  /** @param {number[][]} points @param {string} className @param {string} pane @param {any} renderer
   *  @param {object} [style] of a canvas */
  line(points, className, pane, renderer, style = {}) {
    return L.polyline(points, { className, pane, renderer, interactive: false, ...style }).addTo(this.map);
  }
}

/** @param {number[] | undefined} a @param {number[] | undefined} b @returns {boolean} */
function differ(a, b) {
  return a?.[0] !== b?.[0] || a?.[1] !== b?.[1];
}
