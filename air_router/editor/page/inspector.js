// The selection, in text and numbers.

import { byId, element, numberField, wordField } from "/page/element.js";
import { offset } from "/page/map.js";
import { label } from "./places.js";
import { cornersOf } from "./selection.js";
import { same } from "./store.js";

export class Inspector {
  /** @param {import("./store.js").Store} store @param {import("./selection.js").Selection} selection
   *  @param {import("./order.js").Order} order of the waypoints */
  constructor(store, selection, order) {
    this.store = store;
    this.order = order;
    this.selection = selection;
    this.box = byId("inspector");
    selection.addEventListener("change", () => this.show());
  }

  show() {
    if (this.box.contains(document.activeElement) && document.activeElement.tagName === "INPUT") {
      if (this.shown === JSON.stringify(this.selection.now)) return; // the user writes in it
    }
    this.shown = JSON.stringify(this.selection.now);
    const { now } = this.selection;
    const { state } = this.store;
    this.box.hidden = !now || !state;
    this.box.replaceChildren();
    if (!now || !state) return;
    const place = state.places.find((one) => same(one.keys, now.keys));
    const area = state.areas.find((one) => now.area && same(one.keys, now.area));
    if (place) this.place(place, state);
    else if (area) this.area(area, now);
  }

  /** @param {import("./store.js").Place} place @param {import("./store.js").State} state */
  place(place, state) {
    this.head(label(place));
    this.at(place.at);
    const { settings } = state;
    if (place.kind === "waypoint") {
      const set = (altitude) => this.store.edit({ do: "set_altitude", keys: place.keys, altitude_m: altitude });
      this.box.append(
        numberField("Altitude above home, m", place.altitude_m, set, String(settings.altitude_m)),
      );
      if (place.altitude_m !== null && settings.settable) {
        this.row(["Mission's altitude", () => set(null)]);
      }
    }
    const buttons = [];
    const index = this.order.indexOf(place.keys);
    if (index > 0) buttons.push(["Earlier", () => this.order.step(place.keys, -1)]);
    if (index >= 0 && index + 1 < this.order.waypoints.length) buttons.push(["Later", () => this.order.step(place.keys, 1)]);
    if (place.removable) buttons.push(["Remove", () => this.remove(place.keys), "danger"]);
    if (buttons.length) this.row(...buttons);
  }

  /** @param {import("/page/airspace.js").Area} area @param {import("./selection.js").Selected} now */
  area(area, now) {
    const corner = cornersOf(area).find((one) => same(one.keys, now.keys));
    this.head(area.fence ? "Fence" : "No-fly zone");
    if (!area.fence && this.store.state.settings.settable) {
      this.box.append(wordField("Name", area.name, (name) => name && this.store.edit({ do: "rename", keys: area.keys, name })));
      const crosses = element("input", { type: "checkbox", checked: area.crosses });
      crosses.addEventListener("change", () =>
        this.store.edit({ do: "set_crossing", keys: area.keys, crosses: crosses.checked }));
      this.box.append(element("label", { className: "tick" }, crosses, "crosses the fence on purpose"));
    }
    if (area.circle) {
      const resize = (radius) => this.store.edit({ do: "resize", keys: area.keys, radius_m: radius });
      this.box.append(numberField("Radius, m", area.circle.radius_m, resize));
      this.row(["Make it a polygon", () => this.store.edit({ do: "redraw", keys: area.keys, corners: octagon(area) })]);
    } else {
      const count = cornersOf(area).length;
      const which = corner ? `corner ${now.keys.at(-1) + 1} of ${count}` : `${count} corners`;
      this.box.append(element("p", { textContent: `${which}; click a dashed dot to insert one` }));
    }
    if (corner) this.at(corner.at);
    for (const note of area.notes) this.box.append(element("p", { textContent: note }));
    const buttons = [];
    if (corner && !area.circle) buttons.push(["Remove corner", () => this.remove(corner.keys), "danger"]);
    if (area.removable) {
      buttons.push([area.fence ? "Remove fence" : "Remove zone", () => this.remove(area.keys), "danger"]);
    }
    if (buttons.length) this.row(...buttons);
  }

  /** @param {string} title */
  head(title) {
    const close = element("button", { textContent: "✕", title: "Close (Esc)" });
    close.setAttribute("aria-label", "Close");
    close.addEventListener("click", () => this.selection.choose(null));
    this.box.append(element("h2", {}, title, close));
  }

  /** @param {number[]} at */
  at(at) {
    const { lat, lng } = L.latLng(at).wrap();
    this.box.append(element("p", { textContent: `${lat.toFixed(7)}, ${lng.toFixed(7)}` }));
  }

  /** @param {...any} buttons label, what it does, and perhaps a class */
  row(...buttons) {
    const row = element("div", { className: "row" });
    for (const [text, act, className = ""] of buttons) {
      const button = element("button", { textContent: text, className });
      button.addEventListener("click", act);
      row.append(button);
    }
    this.box.append(row);
  }

  /** @param {import("./store.js").Keys} keys */
  remove(keys) {
    this.store.edit({ do: "remove", keys });
  }
}

/** Corners in the place of a circle: within a fence's, around a zone's. @param {any} area @returns {number[][]} */
function octagon({ circle: { centre, radius_m: radius }, fence }) {
  const away = fence ? radius : radius / Math.cos(Math.PI / 8);
  return Array.from({ length: 8 }, (_, step) => {
    const angle = ((2 * step + 1) * Math.PI) / 8;
    return offset(centre, away * Math.sin(angle), away * Math.cos(angle));
  });
}
