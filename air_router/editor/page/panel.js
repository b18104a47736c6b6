// The panel's lists: problems, the mission's numbers, everything that can be selected.

import { byId, element, numberField, wordField } from "/page/element.js";
import { label } from "./places.js";

/** @type {[string, [string, string, string?][]][]} headings, and under them names, titles, what stands for no value */
const SETTINGS = [
  ["Flight", [
    ["altitude_m", "Altitude above home, m"],
    ["speed_m_s", "Speed, m/s"],
    ["duration_s", "Come home after, s", "no limit"],
    ["endurance_s", "A full battery lasts, s", "unknown"],
    ["battery_reserve", "Come home at a charge (0..1) of"],
  ]],
  ["Timers", [
    ["init_s", "Explore first, s"],
    ["explore_s", "Explore between searches, s"],
    ["search_s", "Wait for a robot, s"],
    ["communicate_s", "Hover over a robot, s"],
    ["hold_s", "Hover at a requested point, s"],
    ["revisit_s", "Visit a robot again after, s"],
  ]],
  ["Planner", [
    ["clearance_m", "Clearance, m"],
    ["tracking_margin_m", "Tracking margin, m"],
    ["max_edge_m", "Longest connection, m"],
  ]],
  ["Team", [["team", "Team file", "none"], ["uav", "Flown by", "the only UAV"]]],
];
const TEXTS = ["team", "uav"];
const OPTIONAL = ["duration_s", "endurance_s", ...TEXTS];

export class Panel {
  /** @param {import("./store.js").Store} store
   *  @param {(keys: import("./store.js").Keys | null, at: number[][]) => void} visit shows a place
   *  @param {import("./order.js").Order} order of the waypoints */
  constructor(store, visit, order) {
    this.store = store;
    this.order = order;
    this.visit = visit;
  }

  /** @param {import("./store.js").State} state */
  show(state) {
    this.problems(state);
    this.settings(state);
    this.list(state);
  }

  /** @param {import("./store.js").State} state */
  problems(state) {
    const wrong = state.problems.filter((problem) => !problem.note).length;
    byId("count").textContent = String(wrong);
    byId("count").classList.toggle("some", wrong > 0);
    const text = JSON.stringify(state.problems);
    if (text === this.problemsShown) return;
    this.problemsShown = text;
    const items = state.problems.map((problem) => {
      const place = `${problem.file}:${problem.line}:${problem.column}`;
      const button = element(
        "button",
        { title: problem.at.length ? "Show it on the map" : "" },
        problem.message,
        element("small", { textContent: problem.code ? `${place} · ${problem.code}` : place }),
      );
      button.addEventListener("click", () => this.visit(problem.feature, problem.at));
      return element("li", { className: problem.note ? "note" : "" }, button);
    });
    const none = element("li", { className: "none", textContent: "No problems: this mission can be flown." });
    byId("problems").replaceChildren(...(items.length ? items : [none]));
  }

  /** @param {import("./store.js").State} state */
  settings({ settings }) {
    const text = JSON.stringify(settings);
    const box = byId("numbers");
    if (text === this.settingsShown || box.contains(document.activeElement)) return;
    this.settingsShown = text;
    box.replaceChildren(...SETTINGS.flatMap(([heading, fields]) => [
      element("h3", { textContent: heading }),
      ...fields.map(([name, title, none]) => this.setting(name, title, settings[name], none)),
    ]), ...this.robots(settings));
    for (const input of box.querySelectorAll("input")) input.disabled ||= !settings.settable;
  }

  /** @param {string} name @param {string} title @param {any} value @param {string} [none] @returns {HTMLElement} */
  setting(name, title, value, none = "") {
    const set = (changed) => this.store.edit({ do: "set_value", name, value: changed });
    const field = TEXTS.includes(name)
      ? wordField(title, value ?? "", (text) => set(text || null), none)
      : numberField(title, value, set, none, OPTIONAL.includes(name));
    field.dataset.setting = name;
    return field;
  }

  /** A box to tick for each robot that may be sought. @param {any} settings @returns {HTMLElement[]} */
  robots({ robots }) {
    if (!robots.length) return [];
    const sought = robots.filter((robot) => robot.sought).map((robot) => robot.name);
    const boxes = robots.map(({ name, sought: checked }) => {
      const box = element("input", { type: "checkbox", checked, disabled: checked && sought.length === 1 });
      box.addEventListener("change", () => this.store.edit({
        do: "seek", robots: box.checked ? [...sought, name] : sought.filter((one) => one !== name),
      }));
      return element("label", { className: "tick" }, box, name);
    });
    return [element("h3", { textContent: "Robots to seek" }), ...boxes];
  }

  /** @param {import("./store.js").State} state */
  list(state) {
    if (!byId("parts").open) return;
    const entries = state.places.map((place) =>
      [label(place), place.keys, [place.at], place.wrong, place.kind === "waypoint" && place.keys !== null]);
    byId("reverse").disabled = this.order.waypoints.length < 2;
    for (const area of state.areas) {
      const at = area.circle ? [area.circle.centre] : area.rings.flatMap((ring) => ring.corners);
      entries.push([area.fence ? "Fence" : `Zone: ${area.name}`, area.keys, at, area.wrong, false]);
    }
    const text = JSON.stringify(entries);
    const box = byId("list");
    if (text === this.listShown) return;
    this.listShown = text;
    const focused = [...box.children].findIndex((item) => item.contains(document.activeElement));
    box.replaceChildren(
      ...entries.map(([name, keys, at, wrong, hasOrder]) => {
        const button = element("button", { textContent: name, className: wrong ? "wrong" : "" });
        button.addEventListener("click", () => this.visit(keys, at));
        const row = element("li", { className: hasOrder ? "waypoint" : "" }, button);
        if (hasOrder) row.append(this.order.grip(row, keys));
        return row;
      }),
    );
    box.children[focused]?.firstChild.focus();
  }
}
