// Radio links: a line from each UAV to each of its peers, thicker where the signal is stronger.

import { line } from "./vehicle.js";

/** Weak and strong signals, by unit; a device's own scale is unknown. @type {Record<string, [number, number]>} */
const SCALES = { dBm: [-90, -50], dB: [0, 40] };
export const GLOW_MS = 1000;

/** @typedef {{peer: string, signal: number | null, unit: string, lit: boolean, glows: boolean, syncs: number}} LinkReport
 *  what a flight reports of a link, and whether it is drawn as one that transfers data */

/** How good a signal is, 0 to 1. @param {number} signal @param {string} unit */
export function strength(signal, unit) {
  const [weak, strong] = SCALES[unit] ?? [signal - 1, signal + 1];
  return Math.min(Math.max((signal - weak) / (strong - weak), 0), 1);
}

/** @param {LinkReport} report @returns {string} "" for a peer without a signal */
export function signalText({ signal, unit }) {
  return signal === null ? "" : `${Math.round(signal)} ${unit}`;
}

export class Links {
  /** Of one flight. @param {any} map @param {any} svg */
  constructor(map, svg) {
    this.map = map;
    this.svg = svg;
    /** With how many syncs there were, until when it glows, and the ends as they are drawn.
     *  @type {Map<string, {line: any, visible: boolean, syncs: number, untilMs: number, ends: string}>} */
    this.shown = new Map();
    this.chosen = true;
  }

  /** @param {LinkReport[]} links */
  show(links) {
    for (const report of links) {
      const link = this.shown.get(report.peer) ?? this.add(report);
      this.glow(link, report);
      link.visible = report.signal !== null || report.glows;
      const weight = 1.5 + (report.signal === null ? 0 : 5 * strength(report.signal, report.unit));
      if (weight !== link.line.options.weight) link.line.setStyle({ weight });
      link.line.getElement()?.classList.toggle("lit", report.glows);
    }
  }

  /** @param {LinkReport} report */
  add(report) {
    const drawn = line(this.map, this.svg, "link");
    drawn.getElement().dataset.peer = report.peer;
    drawn.getElement().classList.toggle("other", !this.chosen);
    const link = { line: drawn, visible: false, syncs: report.syncs, untilMs: 0, ends: "" };
    this.shown.set(report.peer, link);
    return link;
  }

  /** A sync of some milliseconds lights its link for as long as eyes need.
   *  @param {{syncs: number, untilMs: number}} link @param {LinkReport} report */
  glow(link, report) {
    if (report.lit || link.syncs !== report.syncs) link.untilMs = performance.now() + GLOW_MS;
    link.syncs = report.syncs;
    report.glows = performance.now() < link.untilMs;
  }

  /** Draw them where their ends are now. @param {number[] | null} from
   *  @param {(peer: string) => number[] | undefined} placeOf */
  draw(from, placeOf) {
    for (const [peer, link] of this.shown) {
      const to = placeOf(peer);
      const ends = link.visible && from && to ? [from, to] : [];
      const now = String(ends);
      if (now !== link.ends) link.line.setLatLngs(ends);
      link.ends = now;
    }
  }

  /** @param {boolean} chosen whether the panel shows this flight */
  choose(chosen) {
    this.chosen = chosen;
    for (const { line: drawn } of this.shown.values()) drawn.getElement()?.classList.toggle("other", !chosen);
  }

  forget() {
    for (const link of this.shown.values()) link.line.remove();
    this.shown.clear();
  }
}
