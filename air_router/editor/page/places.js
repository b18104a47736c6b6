// Home, waypoints and rally points: markers with numbers that can be dragged.

import { same } from "./store.js";

const L = globalThis.L;
const SIZE = 24;
const LEAST_GAP_PIXELS = 22;
const ICONS = {
  home: '<svg class="icon" viewBox="0 0 24 24"><path d="m4 11 8-7 8 7v9h-5v-6H9v6H4Z"/></svg>',
  rally: '<svg class="icon" viewBox="0 0 24 24"><path d="M6 21V4l12 4-12 5"/></svg>',
};

export class Places {
  /** @param {any} map @param {import("./store.js").Store} store
   *  @param {import("./selection.js").Selection} selection
   *  @param {{picked: (place: import("./store.js").Place) => boolean}} tools may take a click */
  constructor(map, store, selection, tools) {
    this.map = map;
    this.store = store;
    this.selection = selection;
    this.tools = tools;
    /** @type {Map<string, any>} */
    this.markers = new Map();
    this.dragged = null;
    map.on("zoomend", () => this.space());
    selection.addEventListener("change", () => this.mark());
  }

  /** @param {import("./store.js").Place[]} places all that there are now */
  show(places) {
    const left = new Set(this.markers.keys());
    const altitude = this.store.state?.settings.altitude_m;
    const all = altitude !== this.altitude; // then places with an altitude of their own are labelled anew
    const changed = [];
    this.altitude = altitude;
    for (const place of places) {
      const key = `${place.kind} ${place.index}`;
      left.delete(key);
      const marker = this.markers.get(key) ?? this.add(key, place);
      if (marker !== this.dragged) moveTo(marker, place.at);
      if (marker.place !== place || all) changed.push(marker);
      marker.place = place;
    }
    for (const key of left) {
      this.markers.get(key).remove();
      this.markers.delete(key);
    }
    this.places = places;
    this.mark(changed);
    this.space();
  }

  /** @param {string} key @param {import("./store.js").Place} place */
  add(key, place) {
    const free = place.keys !== null;
    const marker = L.marker(place.at, {
      icon: L.divIcon({ className: `place ${place.kind}`, iconSize: [SIZE, SIZE], html: "" }),
      draggable: free,
      autoPan: true,
      keyboard: true,
      title: label(place),
      riseOnHover: true,
      zIndexOffset: place.kind === "rally" ? -2000 : 0,
    }).addTo(this.map);
    marker.getElement().setAttribute("aria-label", label(place));
    marker.getElement().dataset.place = key;
    marker.on("click", () => {
      if (this.tools.picked(marker.place) || !marker.place.keys) return;
      this.selection.choose({ sort: "place", keys: marker.place.keys, area: null });
    });
    marker.on("contextmenu", () => this.remove(marker.place));
    if (free) {
      marker.on("dragstart", () => {
        this.dragged = marker;
        this.gesture = this.store.gesture();
        this.selection.choose({ sort: "place", keys: marker.place.keys, area: null });
      });
      marker.on("drag", () => this.move(marker));
      marker.on("dragend", () => {
        const { gesture } = this;
        this.move(marker).then(() => this.drop(gesture));
      });
    }
    this.markers.set(key, marker);
    return marker;
  }

  /** @param {any} marker */
  move(marker) {
    const { lat, lng } = marker.getLatLng();
    return this.store.edit({ do: "move", keys: marker.place.keys, to: [lat, lng] }, this.gesture);
  }

  /** @param {string} gesture that has come to its end; the next one may have begun meanwhile */
  drop(gesture) {
    if (gesture !== this.gesture) return;
    this.dragged = null;
    if (this.store.state) this.show(this.store.state.places);
  }

  /** @param {import("./store.js").Place} place */
  remove(place) {
    if (place.keys) this.store.edit({ do: "remove", keys: place.keys });
  }

  /** Update the markers. @param {Iterable<any>} [markers] all, if none are given */
  mark(markers = this.markers.values()) {
    for (const marker of markers) {
      const { place } = marker;
      const element = marker.getElement();
      const list = element.classList;
      list.toggle("wrong", place.wrong);
      list.toggle("fixed", !place.keys);
      list.toggle("selected", this.selection.has(place.keys));
      list.toggle("chosen", this.tools.chosen?.some((node) => node === place.node) ?? false);
      const own = place.kind === "waypoint" && place.altitude_m !== null
        && place.altitude_m !== this.store.state?.settings.altitude_m;
      const html = (ICONS[place.kind] ?? String(place.index))
        + (own ? `<span class="own">${place.altitude_m} m</span>` : "");
      if (marker.html !== html) element.innerHTML = html;
      marker.html = html;
    }
  }

  /** Numbers make room for dots where waypoints stand too close. */
  space() {
    const points = (this.places ?? [])
      .filter((place) => place.kind === "waypoint")
      .map((place) => this.map.latLngToLayerPoint(place.at));
    const bounds = L.bounds(points);
    const size = points.length > 1 ? bounds.getSize() : null;
    const gap = size ? Math.sqrt((size.x * size.y) / points.length) : Infinity;
    this.map.getContainer().classList.toggle("dense", gap < LEAST_GAP_PIXELS);
    this.map.getContainer().classList.toggle("close", gap < 2 * LEAST_GAP_PIXELS);
  }

  /** Put the keyboard on a place. @param {import("./store.js").Keys} keys */
  focus(keys) {
    for (const marker of this.markers.values()) {
      if (same(marker.place.keys, keys)) marker.getElement().focus({ preventScroll: true });
    }
  }
}

/** Move a marker that is elsewhere. @param {any} marker @param {number[]} at */
function moveTo(marker, at) {
  const { lat, lng } = marker.getLatLng();
  if (lat !== at[0] || lng !== at[1]) marker.setLatLng(at);
}

/** @param {import("./store.js").Place} place @returns {string} */
export function label(place) {
  if (place.kind === "home") return "Home";
  return place.kind === "rally" ? `Rally point ${place.index}` : `Waypoint ${place.index}`;
}
