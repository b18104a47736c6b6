// The log of all flights, the newest line first.

import { byId, element } from "/page/element.js";

const MAX_LINES = 200;
const LABELS = { warning: "Warning", alarm: "ALARM" };

export class Log {
  constructor() {
    /** Of each flight how many lines there are, and when the last one was.
     *  @type {Map<import("./flight.js").Flight, {n: number, atMs: number}>} */
    this.newest = new Map();
    /** @type {{item: any, flight: import("./flight.js").Flight, atMs: number, what: string}[]} `what`: kind and text */
    this.shown = [];
  }

  /** Vehicles' clocks differ: lines sent to a new page are sorted by their age, all others are new.
   *  @param {import("./flight.js").Flight} flight
   *  A repeated line replaces the one before, with the number of repeats.
   *  @param {{now_s: number,
   *    lines: {n: number, t: number, kind: string, severity?: string, text: string, again?: string}[]}} message */
  add(flight, { now_s: nowS, lines }) {
    const before = this.newest.get(flight);
    const last = before ?? { n: 0, atMs: 0 };
    for (const line of lines.filter((one) => one.n > last.n)) {
      last.n = line.n;
      last.atMs = Math.max(last.atMs, Date.now() - (before ? 0 : (nowS - line.t) * 1000));
      const when = element("small", { textContent: `${line.t.toFixed(0)} s ` });
      const who = flight.colour ? [element("b", { className: flight.colour, textContent: `${flight.name} ` })] : [];
      const label = line.severity ? [element("strong", { textContent: `${LABELS[line.severity]}: ` })] : [];
      const often = line.again ? [element("small", { className: "again", textContent: ` ${line.again}` })] : [];
      const className = `${line.kind} ${line.severity ?? ""}`.trim();
      const what = `${line.kind} ${line.text}`;
      if (line.again) this.drop(flight, what);
      const item = element("li", { className }, when, ...who, ...label, line.text, ...often);
      this.insert({ item, flight, atMs: last.atMs, what });
    }
    this.newest.set(flight, last);
    for (const { item } of this.shown.splice(MAX_LINES)) item.remove();
  }

  /** Remove an earlier line with this text. @param {import("./flight.js").Flight} flight @param {string} what */
  drop(flight, what) {
    const found = this.shown.findIndex((line) => line.flight === flight && line.what === what);
    if (found >= 0) this.shown.splice(found, 1)[0].item.remove();
  }

  /** @param {{item: any, flight: import("./flight.js").Flight, atMs: number, what: string}} line */
  insert(line) {
    const found = this.shown.findIndex(({ atMs }) => atMs <= line.atMs);
    const place = found < 0 ? this.shown.length : found;
    byId("log").insertBefore(line.item, this.shown[place]?.item ?? null);
    this.shown.splice(place, 0, line);
  }

  /** Everything anew: another program runs there now. @param {import("./flight.js").Flight} flight */
  forget(flight) {
    this.newest.delete(flight);
    for (const line of this.shown) if (line.flight === flight) line.item.remove();
    this.shown = this.shown.filter((line) => line.flight !== flight);
  }
}
