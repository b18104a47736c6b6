// What a click on the map does: select, add a waypoint, draw a zone or the fence, request a route.

import { same } from "./store.js";

const L = globalThis.L;
const CLOSE_PIXELS = 12;
const HINTS = {
  waypoint: "Click where the next waypoint should be; it is inserted behind the selected one. Esc ends.",
  zone: "Click the corners of the zone; click the first one again, or press Enter, to close it.",
  fence: "Click the corners of the fence; click the first one again, or press Enter, to close it. It replaces the present fence.",
  circle: "Click the centre of the zone, then its edge.",
  rally: "Click where the vehicle may land in an emergency.",
  route: "Click two waypoints, or home, to see the route between them.",
};

export class Tools extends EventTarget {
  /** @param {any} map @param {import("./store.js").Store} store
   *  @param {import("./selection.js").Selection} selection @param {import("./legs.js").Legs} legs */
  constructor(map, store, selection, legs) {
    super();
    this.map = map;
    this.store = store;
    this.selection = selection;
    this.legs = legs;
    this.tool = "select";
    /** @type {number[][]} */
    this.corners = [];
    /** @type {number[]} nodes that were clicked for a route */
    this.chosen = [];
    this.adding = Promise.resolve();
    this.shape = L.polygon([], {
      className: "sketching", interactive: false, renderer: L.svg({ pane: "route" }), pane: "route",
    }).addTo(map);
    map.on("click", (event) => this.clicked([event.latlng.lat, event.latlng.lng]));
    map.on("mousemove", (event) => this.follow([event.latlng.lat, event.latlng.lng]));
    map.on("dblclick", () => this.finish());
    for (const button of document.querySelectorAll("[data-tool]")) {
      button.addEventListener("click", () => this.choose(button.dataset.tool));
    }
  }

  /** @param {string} tool */
  choose(tool) {
    this.tool = tool;
    this.corners = [];
    this.shape.setLatLngs([]);
    this.pick([]);
    if (!["select", "waypoint", "fence"].includes(tool)) this.selection.choose(null);
    for (const button of document.querySelectorAll("[data-tool]")) {
      button.setAttribute("aria-pressed", String(button.dataset.tool === tool));
    }
    this.map.getContainer().classList.toggle("drawing", tool !== "select" && tool !== "route");
    this.say(HINTS[tool] ?? "");
  }

  /** @param {string} text */
  say(text) {
    this.dispatchEvent(new CustomEvent("hint", { detail: text }));
  }

  /** A click on the map, or on an area. @param {number[]} at */
  clicked(at) {
    switch (this.tool) {
      case "select":
        this.selection.choose(null);
        break;
      case "waypoint":
        this.addWaypoint(at);
        break;
      case "rally":
        this.store.edit({ do: "add_rally_point", at });
        this.choose("select");
        break;
      case "zone":
      case "fence":
        if (this.corners.length > 2 && this.near(this.corners[0], at)) this.finish();
        else if (!this.corners.some((corner) => this.near(corner, at, 3))) this.corners.push(at);
        this.follow(at);
        break;
      case "circle":
        if (this.corners.length === 0) this.corners = [at];
        else this.addCircle(at);
        break;
      default:
    }
  }

  /** A click on a place. @param {import("./store.js").Place} place @returns {boolean} it was used */
  picked(place) {
    if (this.tool === "select") return false;
    if (this.tool === "route" && place.node !== null) {
      const chosen = this.chosen.length === 2 ? [] : this.chosen;
      if (!chosen.includes(place.node)) this.pick([...chosen, place.node]);
    } else if (this.tool !== "route" && this.tool !== "waypoint") {
      this.clicked(place.at);
    }
    return this.tool !== "waypoint";
  }

  /** One after the other: the next click waits until the waypoint before it is there.
   *  @param {number[]} at @returns {Promise<void>} */
  addWaypoint(at) {
    this.adding = this.adding.then(() => this.insertWaypoint(at));
    return this.adding;
  }

  /** @param {number[]} at */
  async insertWaypoint(at) {
    const { places } = this.store.state;
    const own = places.filter((place) => place.kind === "waypoint" && place.keys);
    const before = own.find((place) => this.selection.has(place.keys))?.index ?? own.length;
    if (await this.store.edit({ do: "add_waypoint", index: before, at })) {
      const added = this.store.state.places.find((p) => p.kind === "waypoint" && p.index === before + 1);
      if (added?.keys) this.selection.choose({ sort: "place", keys: added.keys, area: null });
    }
  }

  /** @param {number[]} edge */
  addCircle(edge) {
    const radius = Math.max(this.map.distance(this.corners[0], edge), 1);
    this.addArea({ corners: this.corners, radius_m: radius });
  }

  /** Close the zone that is being drawn. */
  finish() {
    if (this.tool === "zone" && this.corners.length > 2) this.addArea({ corners: this.corners });
    if (this.tool === "fence" && this.corners.length > 2) this.drawFence(this.corners);
  }

  /** @param {{corners: number[][], radius_m?: number}} area */
  async addArea(area) {
    this.choose("select");
    if (await this.store.edit({ do: "add_area", ...area })) {
      const added = this.store.state.areas.filter((one) => one.keys && !one.fence
        && Boolean(one.circle) === Boolean(area.radius_m)).at(-1);
      if (added) this.selection.choose({ sort: "area", keys: added.keys, area: added.keys });
    }
  }

  /** The selected fence gets these corners, or the only one; or it is a new one. @param {number[][]} corners */
  async drawFence(corners) {
    const fences = this.store.state.areas.filter((area) => area.fence && area.keys);
    const old = fences.find((area) => this.selection.has(area.keys)) ?? fences[0];
    this.choose("select");
    const edit = old ? { do: "redraw", keys: old.keys, corners } : { do: "add_area", fence: true, corners };
    if (!(await this.store.edit(edit))) return;
    const drawn = this.store.state.areas.findLast((area) => area.fence && (!old || same(area.keys, old.keys)));
    if (drawn) this.selection.choose({ sort: "area", keys: drawn.keys, area: drawn.keys });
  }

  /** Show the shape being drawn. @param {number[]} at where the pointer is */
  follow(at) {
    if (["zone", "fence"].includes(this.tool) && this.corners.length) this.shape.setLatLngs([...this.corners, at]);
    if (this.tool === "circle" && this.corners.length) {
      const radius = this.map.distance(this.corners[0], at);
      const round = L.circle(this.corners[0], { radius }).addTo(this.map);
      const { _northEast: top, _southWest: low } = round.getBounds();
      round.remove();
      this.shape.setLatLngs(ellipse(this.corners[0], (top.lat - low.lat) / 2, (top.lng - low.lng) / 2));
    }
  }

  /** @param {number[]} a @param {number[]} b @param {number} [pixels] */
  near(a, b, pixels = CLOSE_PIXELS) {
    return this.map.latLngToLayerPoint(a).distanceTo(this.map.latLngToLayerPoint(b)) < pixels;
  }

  /** Choose the ends of a route. @param {number[]} nodes none, one or two */
  pick(nodes) {
    this.chosen = nodes;
    this.dispatchEvent(new Event("chosen"));
    this.showRoute();
  }

  /** Show the route anew: the mission may have changed. */
  async showRoute() {
    if (this.chosen.length < 2) {
      this.legs.route.setLatLngs([]);
      return;
    }
    const [start, end] = this.chosen;
    const answer = await this.store.ask("route", { start, end });
    if (!answer || this.chosen[0] !== start || this.chosen[1] !== end) return;
    const { route } = answer;
    this.legs.route.setLatLngs(route.points ?? []);
    const name = (node) => (node ? String(node) : "home");
    const ends = `${name(start)} to ${name(end)}: `;
    if (!route.points) {
      this.say(`${ends}no route. ${route.reason}`);
      return;
    }
    const near = route.closest_to ? `, closest ${route.closest_m} m to ${route.closest_to}` : "";
    const via = route.nodes.slice(1, -1).map((node) => (node === null ? "corner" : name(node)));
    this.say(`${ends}${route.length_m} m, about ${route.time_s} s${near}`
      + (via.length ? `; by ${via.join(", ")}` : "; straight"));
  }
}

/** @param {number[]} centre @param {number} height @param {number} width @returns {number[][]} */
function ellipse(centre, height, width) {
  return Array.from({ length: 48 }, (_, step) => {
    const angle = (step * Math.PI) / 24;
    return [centre[0] + height * Math.sin(angle), centre[1] + width * Math.cos(angle)];
  });
}

