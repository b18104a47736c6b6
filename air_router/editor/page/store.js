// The mission as the server has it, and requests to the server.

/** @typedef {(string | number)[]} Keys
 *  @typedef {{keys: Keys | null, kind: "home" | "waypoint" | "rally", index: number, node: number | null,
 *    at: number[], altitude_m: number | null, wrong: boolean, removable: boolean}} Place
 *  @typedef {{code: string, message: string, file: string, line: number, column: number, note: boolean,
 *    feature: Keys | null, at: number[][]}} Problem
 *  @typedef {{revision: number, file: string, dirty: boolean, undo: string | null, redo: string | null,
 *    places: Place[], areas: import("/page/airspace.js").Area[],
 *    edges: number[][], detours: number[][][],
 *    legs: {from: number, to: number, way: string, points: number[][]}[],
 *    problems: Problem[], settings: any}} State */

import { Link } from "/page/socket.js";

export class Store extends EventTarget {
  constructor() {
    super();
    /** @type {State | null} */
    this.state = null;
    this.gestures = 0;
    /** @type {{edit: any, gesture: string | null, done: ((ok: boolean) => void)[]}[]} */
    this.queue = [];
    this.busy = false;
    this.behind = false;
    this.link = new Link(
      (message) => this.receive(message),
      (connected) => this.dispatchEvent(new CustomEvent("connected", { detail: connected })),
    );
  }

  /** @param {any} message */
  receive(message) {
    if (message.type !== "state") this.dispatchEvent(new CustomEvent(message.type, { detail: message }));
    else if ("since" in message && message.since !== this.state?.revision) this.catchUp();
    else {
      this.state = "since" in message ? changed(this.state, message) : message;
      this.dispatchEvent(new CustomEvent("state", { detail: this.state }));
    }
  }

  /** This page has missed an update: the server keeps only the newest message of a kind. */
  async catchUp() {
    if (this.behind) return;
    this.behind = true;
    const answer = await this.ask("state");
    this.behind = false;
    if (answer) this.receive(answer.state);
  }

  /** A name for edits that are undone together. @returns {string} */
  gesture() {
    this.gestures += 1;
    return `${Date.now()} ${this.gestures}`;
  }

  /** Change the mission. Of a drag, only the newest place waits while the program is busy.
   *  @param {any} edit @param {string | null} [gesture]
   *  @returns {Promise<boolean>} whether it was done */
  edit(edit, gesture = null) {
    return new Promise((done) => {
      const last = this.queue.at(-1);
      const same = last && gesture && last.gesture === gesture && last.edit.do === edit.do;
      if (same && edit.do !== "add_corner") {
        last.edit = edit;
        last.done.push(done);
      } else {
        this.queue.push({ edit, gesture, done: [done] });
      }
      this.work();
    });
  }

  async work() {
    if (this.busy) return;
    this.busy = true;
    for (let next = this.queue.shift(); next; next = this.queue.shift()) {
      const { edit, gesture, done } = next;
      const ok = await this.ask("edit", { edit, gesture, revision: this.state?.revision });
      done.forEach((resolve) => resolve(ok !== null));
    }
    this.busy = false;
  }

  /** Send a request; a refusal is dispatched as a "refused" event.
   *  @param {string} what @param {object} [more] @returns {Promise<any>} null if it was refused */
  async ask(what, more = {}) {
    try {
      return await this.link.ask({ ask: what, ...more });
    } catch (error) {
      this.dispatchEvent(new CustomEvent("refused", { detail: error }));
      return null;
    }
  }
}

/** A state with an update; unchanged parts stay the same objects.
 *  @param {any} state @param {any} update @returns {State} */
function changed(state, { since, ...update }) {
  const next = { ...state };
  for (const [name, value] of Object.entries(update)) {
    next[name] = value;
    if (!Array.isArray(state[name])) continue;
    next[name] = state[name].slice(0, value.length);
    for (const [index, one] of Object.entries(value.at)) next[name][Number(index)] = one;
  }
  return next;
}

/** @param {Keys | null | undefined} a @param {Keys | null | undefined} b */
export function same(a, b) {
  return JSON.stringify(a ?? null) === JSON.stringify(b ?? null);
}
