// The panel's lists: problems, the mission's numbers, everything that can be selected.

import { byId, element, numberField } from "/page/element.js";
import { label } from "./places.js";

const NUMBERS = [
  ["altitude_m", "Altitude above home, m"],
  ["speed_m_s", "Speed, m/s"],
  ["clearance_m", "Clearance, m"],
  ["tracking_margin_m", "Tracking margin, m"],
  ["max_edge_m", "Longest connection, m"],
];

export class Panel {
  /** @param {import("./store.js").Store} store
   *  @param {(keys: import("./store.js").Keys | null, at: number[][]) => void} visit shows a place */
  constructor(store, visit) {
    this.store = store;
    this.visit = visit;
  }

  /** @param {import("./store.js").State} state */
  show(state) {
    this.problems(state);
    this.numbers(state);
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
    const none = element("li", { className: "none", textContent: "None: this mission can be flown." });
    byId("problems").replaceChildren(...(items.length ? items : [none]));
  }

  /** @param {import("./store.js").State} state */
  numbers({ settings }) {
    const text = JSON.stringify(settings);
    const box = byId("numbers");
    if (text === this.numbersShown || box.contains(document.activeElement)) return;
    this.numbersShown = text;
    const fields = NUMBERS.map(([name, title]) => {
      const field = numberField(title, settings[name], (value) =>
        this.store.edit({ do: "set_number", name, value }),
      );
      field.querySelector("input").disabled = !settings.settable;
      return field;
    });
    box.replaceChildren(...fields);
  }

  /** @param {import("./store.js").State} state */
  list(state) {
    const entries = state.places.map((place) => [label(place), place.keys, [place.at], place.wrong]);
    for (const area of state.areas) {
      const at = area.circle ? [area.circle.centre] : area.rings.flatMap((ring) => ring.corners);
      entries.push([area.fence ? "Fence" : `Zone: ${area.name}`, area.keys, at, area.wrong]);
    }
    const text = JSON.stringify(entries);
    const box = byId("list");
    if (text === this.listShown || !byId("parts").open) return;
    this.listShown = text;
    const focused = [...box.children].findIndex((item) => item.contains(document.activeElement));
    box.replaceChildren(
      ...entries.map(([name, keys, at, wrong]) => {
        const button = element("button", { textContent: name, className: wrong ? "wrong" : "" });
        button.addEventListener("click", () => this.visit(keys, at));
        return element("li", {}, button);
      }),
    );
    box.children[focused]?.firstChild.focus();
  }
}
