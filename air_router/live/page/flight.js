// One flight: the connection to it, its newest messages, and what of it is always on the map.

import { Link, NO_ANSWER } from "/page/socket.js";
import { GLOW_MS, Links } from "./links.js";
import { boundsOf } from "./scenery.js";
import { Vehicle } from "./vehicle.js";

const COLOURS = 6;
const MARKED = ["state", "answer"];
const MOST_MARKS = 200;
const MOST_ROWS = 3600;
/** What comes often is shown once a frame, the newest only. */
const OFTEN = ["vehicle", "robots", "links"];

/** @typedef {{received: (flight: Flight, message: any) => void, due: () => void, pressed: (flight: Flight) => void,
 *   connected: (flight: Flight) => void}} Watcher is called for messages, due frames, clicks and connections */

export class Flight {
  /** @param {any} map @param {any} svg @param {import("./ground.js").Grounds} grounds
   *  @param {{name: string, socket: string}} where
   *  @param {number} number counted from 1; 0 for the only one @param {Watcher} watcher */
  constructor(map, svg, grounds, where, number, watcher) {
    this.name = where.name;
    this.colour = number ? `uav${((number - 1) % COLOURS) + 1}` : "";
    this.watcher = watcher;
    this.grounds = grounds;
    this.ground = null;
    this.shape = new Vehicle(map, svg, this.colour, () => watcher.pressed(this));
    this.lines = new Links(map, svg);
    /** @type {any} */
    this.scenery = null;
    this.bounds = null;
    /** @type {any} */
    this.vehicle = null;
    /** @type {import("./robots.js").RobotReport[]} */
    this.robots = [];
    /** @type {any[]} */
    this.links = [];
    /** A row for each second: time, altitude, speed, battery, clearance, and of each peer [RSSI, lit, bytes].
     *  @type {any[][]} */
    this.rows = [];
    /** @type {{n: number, t: number, kind: string, text: string}[]} what was decided, for the timeline */
    this.marks = [];
    this.playback = null;
    this.connected = false;
    this.why = "";
    this.silentSinceMs = performance.now();
    this.dims = 0;
    /** @type {Map<string, any>} */
    this.newest = new Map();
    this.link = new Link((message) => this.receive(message), (...now) => this.changed(...now), where.socket);
  }

  /** Seconds since the connection was lost; 0 while connected. */
  get silentForS() {
    return this.connected ? 0 : (performance.now() - this.silentSinceMs) / 1000;
  }

  /** Whether it is over. */
  get isOver() {
    return this.vehicle?.state === "DONE";
  }

  /** Whether it should be there and is not; one that has not come yet may still come. */
  get isLost() {
    return !this.connected && !this.isOver && (this.vehicle ? this.why : this.why && this.why !== NO_ANSWER);
  }

  /** @param {any} message */
  receive(message) {
    if (OFTEN.includes(message.type)) {
      this.newest.set(message.type, message);
      this.watcher.due();
    } else {
      this.understand(message);
    }
  }

  /** Take what came since the last frame. */
  catchUp() {
    const messages = [...this.newest.values()];
    this.newest.clear();
    messages.forEach((message) => this.understand(message));
  }

  /** Nonsense must not cost the other flights anything. @param {any} message */
  understand(message) {
    try {
      this.take(message);
      this.watcher.received(this, message);
    } catch (error) {
      console.error(error);
      this.link.drop();
    }
  }

  /** @param {any} message */
  take(message) {
    switch (message.type) {
      case "welcome": // everything that is known follows
        this.robots = [];
        this.rows = [];
        this.marks = [];
        this.shape.forget();
        this.lines.forget();
        break;
      case "scenery":
        message.places.forEach(({ at }) => checkPlace(at));
        checkPlaces([message.edges, message.areas.map(({ outline, buffers }) => [outline, buffers])]);
        message.areas.forEach(({ label }) => label && checkPlace(label));
        this.scenery = message;
        this.bounds = boundsOf(message);
        break;
      case "vehicle":
        checkPlaces(message.route);
        if (message.at !== null) checkPlace(message.at);
        this.vehicle = message;
        this.name = String(message.name);
        this.shape.show(message);
        break;
      case "robots":
        message.robots.forEach(({ at }) => checkPlace(at));
        checkPlaces(message.robots.map(({ way }) => way));
        this.robots = message.robots;
        break;
      case "links":
        this.links = message.links;
        this.lines.show(message.links);
        clearTimeout(this.dims);
        if (message.links.some(({ glows, lit }) => glows && !lit)) this.dims = setTimeout(() => this.dim(message), GLOW_MS);
        break;
      case "track":
        message.points.forEach(checkPlace);
        this.shape.addTrack(message);
        break;
      case "map":
        message.bounds.forEach(checkPlace);
        this.ground = this.grounds.show(this, message);
        break;
      case "piece":
        this.ground?.add(message);
        break;
      case "log":
        this.marks.push(...message.lines.filter(({ kind }) => MARKED.includes(kind)));
        this.marks.splice(0, this.marks.length - MOST_MARKS);
        break;
      case "rows":
        this.rows.push(...message.rows);
        this.rows.splice(0, this.rows.length - MOST_ROWS);
        break;
      case "record": // the whole flight, wherever its film stands
        this.rows = message.rows;
        this.marks = message.marks.filter(({ kind }) => MARKED.includes(kind));
        break;
      case "playback":
        this.playback = message;
        break;
      default: // for the watcher
    }
  }

  /** Of a film that is paused nothing new comes that ends a glow. @param {any} message */
  dim(message) {
    if (!this.newest.has("links")) this.receive(message);
  }

  /** @param {boolean} chosen whether the panel shows it */
  choose(chosen) {
    this.shape.choose(chosen);
    this.lines.choose(chosen);
  }

  /** @param {boolean} connected @param {string} why it is not */
  changed(connected, why) {
    if (this.connected && !connected) this.silentSinceMs = performance.now();
    this.connected = connected;
    this.why = why;
    this.watcher.connected(this);
  }
}

// Whether a flight's message can be drawn: on one map, an invalid position would stop all others.

/** @param {any} at a place in degrees @throws {TypeError} it is none */
function checkPlace(at) {
  if (!Array.isArray(at) || at.length !== 2 || !at.every(Number.isFinite)) throw new TypeError("not a position");
}

/** @param {any} nested lists of lists, in the end of places @throws {TypeError} it is something else */
function checkPlaces(nested) {
  if (Array.isArray(nested) && !nested.some(Number.isFinite)) nested.forEach(checkPlaces);
  else checkPlace(nested);
}
