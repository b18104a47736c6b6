// Who is heard: a line from each UAV to each of its peers, the thicker the better.

import { line } from "./vehicle.js";

/** What is weak and strong, by unit; a device's own scale is not known. @type {Record<string, [number, number]>} */
const SCALES = { dBm: [-90, -50], dB: [0, 40] };
export const GLOW_MS = 1000;

/** @typedef {{peer: string, signal: number | null, unit: string, lit: boolean, glows: boolean, syncs: number}} Told
 *  what a flight tells of a link, and whether it is shown as one that carries data */

/** How good a signal is, 0 to 1. @param {number} signal @param {string} unit */
export function strength(signal, unit) {
  const [weak, strong] = SCALES[unit] ?? [signal - 1, signal + 1];
  return Math.min(Math.max((signal - weak) / (strong - weak), 0), 1);
}

/** @param {Told} told @returns {string} "" for a peer that is not heard */
export function words({ signal, unit }) {
  return signal === null ? "" : `${Math.round(signal)} ${unit}`;
}

export class Links {
  /** Of one flight. @param {any} map @param {any} svg */
  constructor(map, svg) {
    this.map = map;
    this.svg = svg;
    /** With how many syncs there were, until when it glows, and the ends as they are drawn.
     *  @type {Map<string, {line: any, heard: boolean, syncs: number, untilMs: number, ends: string}>} */
    this.shown = new Map();
    this.chosen = true;
  }

  /** @param {Told[]} links */
  show(links) {
    for (const told of links) {
      const link = this.shown.get(told.peer) ?? this.add(told);
      this.glow(link, told);
      link.heard = told.signal !== null || told.glows;
      const weight = 1.5 + (told.signal === null ? 0 : 5 * strength(told.signal, told.unit));
      if (weight !== link.line.options.weight) link.line.setStyle({ weight });
      link.line.getElement()?.classList.toggle("lit", told.glows);
    }
  }

  /** @param {Told} told */
  add(told) {
    const drawn = line(this.map, this.svg, "link");
    drawn.getElement().dataset.peer = told.peer;
    drawn.getElement().classList.toggle("other", !this.chosen);
    const link = { line: drawn, heard: false, syncs: told.syncs, untilMs: 0, ends: "" };
    this.shown.set(told.peer, link);
    return link;
  }

  /** A sync of some milliseconds lights its link for as long as eyes need.
   *  @param {{syncs: number, untilMs: number}} link @param {Told} told */
  glow(link, told) {
    if (told.lit || link.syncs !== told.syncs) link.untilMs = performance.now() + GLOW_MS;
    link.syncs = told.syncs;
    told.glows = performance.now() < link.untilMs;
  }

  /** Draw them where their ends are now. @param {number[] | null} from
   *  @param {(peer: string) => number[] | undefined} placeOf */
  draw(from, placeOf) {
    for (const [peer, link] of this.shown) {
      const to = placeOf(peer);
      const ends = link.heard && from && to ? [from, to] : [];
      const now = String(ends);
      if (now !== link.ends) link.line.setLatLngs(ends);
      link.ends = now;
    }
  }

  /** @param {boolean} chosen whether the panel tells of this flight */
  choose(chosen) {
    this.chosen = chosen;
    for (const { line: drawn } of this.shown.values()) drawn.getElement()?.classList.toggle("other", !chosen);
  }

  forget() {
    for (const link of this.shown.values()) link.line.remove();
    this.shown.clear();
  }
}
