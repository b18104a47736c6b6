// One tab for each UAV, if there are several: who it is, what it does, for how long; one of them is chosen.

import { byId, element, setText } from "/page/element.js";

export class Tabs {
  /** @param {import("./flight.js").Flight[]} flights
   *  @param {(flight: import("./flight.js").Flight) => void} choose takes the one that was pressed */
  constructor(flights, choose) {
    this.flights = flights;
    this.choose = choose;
    this.tabs = flights.map((flight) => this.add(flight));
    byId("flights").hidden = false;
    byId("tabs").addEventListener("keydown", (event) => this.step(event));
    document.addEventListener("keydown", (event) => {
      const { ctrlKey, altKey, metaKey, target } = event;
      if (ctrlKey || altKey || metaKey || document.querySelector("dialog[open]")) return;
      if (/** @type {Element} */ (target).closest("input, select")) return;
      const flight = flights[Number(event.key) - 1];
      if (flight) choose(flight);
    });
  }

  /** @param {import("./flight.js").Flight} flight */
  add(flight) {
    const parts = { name: element("strong"), state: element("span"), left: element("small") };
    const tab = element("button", { className: flight.colour }, parts.name, parts.state, parts.left);
    tab.setAttribute("role", "tab");
    tab.setAttribute("aria-controls", "panel");
    tab.addEventListener("click", () => this.choose(flight));
    byId("tabs").append(tab);
    return { tab, ...parts };
  }

  /** Arrows go from tab to tab. @param {KeyboardEvent} event */
  step(event) {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!step) return;
    event.preventDefault();
    const at = this.tabs.findIndex(({ tab }) => tab === document.activeElement);
    const next = (at + step + this.tabs.length) % this.tabs.length;
    this.choose(this.flights[next]);
    this.tabs[next].tab.focus();
  }

  /** @param {import("./flight.js").Flight} chosen */
  show(chosen) {
    this.flights.forEach((flight, index) => {
      const { tab, name, state, left } = this.tabs[index];
      const { vehicle, connected } = flight;
      const label = vehicle && !connected && !flight.isOver ? "offline" : vehicle?.state ?? "…";
      setText(name, flight.name);
      setText(state, label);
      state.className = `chip ${vehicle ? label : "none"}`;
      setText(left, connected && vehicle?.left_s != null ? `${Math.ceil(vehicle.left_s)} s` : "");
      tab.title = `${flight.name} (${index + 1})${connected ? "" : `: ${flight.why}`}`;
      tab.setAttribute("aria-selected", String(flight === chosen));
      tab.tabIndex = flight === chosen ? 0 : -1;
    });
  }

  /** Bring the chosen one into view. @param {import("./flight.js").Flight} chosen */
  reveal(chosen) {
    this.tabs[this.flights.indexOf(chosen)].tab.scrollIntoView({ block: "nearest", inline: "nearest" });
  }
}
