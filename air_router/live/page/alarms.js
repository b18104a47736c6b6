// What the pilot or the operator has to act on now: a banner that stays, and a sound.

import { byId, element, setText } from "/page/element.js";

const SOUND_EVERY_MS = 2000;
const WARNING_MS = 20000;
/** Hertz and seconds of the tones of an alarm. */
const TONES = [[880, 0], [660, 0.25], [880, 0.5]];
const TONE_S = 0.2;

/** @typedef {{n: number, t: number, severity: "alarm" | "warning", text: string, instruction: string}} Alarm */

export class Alarms {
  constructor() {
    this.sound = new Sound(() => this.draw());
    /** The alarms of each flight now. @type {Map<import("./flight.js").Flight, Alarm[]>} */
    this.alarmsOf = new Map();
    /** Keys of those that a person has acknowledged, on this page. @type {Set<string>} */
    this.acknowledged = new Set();
    /** When each was shown first. @type {Map<string, number>} */
    this.since = new Map();
    /** @type {Map<string, any>} */
    this.rows = new Map();
    this.timer = 0;
  }

  /** @param {import("./flight.js").Flight} flight @param {{alarms: Alarm[]}} message */
  show(flight, { alarms }) {
    this.alarmsOf.set(flight, alarms);
    this.draw();
  }

  /** Another program runs there now. @param {import("./flight.js").Flight} flight */
  forget(flight) {
    for (const key of [...this.acknowledged]) if (key.startsWith(`${flight.name} `)) this.acknowledged.delete(key);
    this.alarmsOf.delete(flight);
    this.draw();
  }

  /** @returns {Map<string, {flight: import("./flight.js").Flight, alarm: Alarm}>} those that are shown */
  get open() {
    const open = new Map();
    for (const [flight, alarms] of this.alarmsOf) {
      for (const alarm of alarms) {
        const key = `${flight.name} ${alarm.n}`;
        if (!this.since.has(key)) this.since.set(key, performance.now());
        const old = alarm.severity === "warning" && performance.now() - this.since.get(key) > WARNING_MS;
        if (!this.acknowledged.has(key) && !old) open.set(key, { flight, alarm });
      }
    }
    return open;
  }

  draw() {
    const open = this.open;
    for (const [key, row] of this.rows) {
      if (open.has(key)) continue;
      row.remove();
      this.rows.delete(key);
    }
    // The newest first; alarms before warnings.
    for (const [key, { flight, alarm }] of open) if (!this.rows.has(key)) this.add(key, flight, alarm);
    const alarmed = [...open.values()].some(({ alarm }) => alarm.severity === "alarm");
    byId("alarms").hidden = open.size === 0;
    document.body.classList.toggle("alarmed", alarmed);
    setText(byId("sound"), alarmed && !this.sound.isOn ? "Sound is off: click or press a key on this page to hear alarms." : "");
    this.sound.play(alarmed && !document.body.classList.contains("recorded"));
    clearTimeout(this.timer);
    if (open.size) this.timer = setTimeout(() => this.draw(), 1000);
  }

  /** @param {string} key @param {import("./flight.js").Flight} flight @param {Alarm} alarm */
  add(key, flight, alarm) {
    const isAlarm = alarm.severity === "alarm";
    const button = element("button", { textContent: isAlarm ? "Acknowledge" : "Close" });
    button.addEventListener("click", () => {
      this.acknowledged.add(key);
      this.draw();
    });
    const who = flight.colour ? `${flight.name}: ` : "";
    const row = element("div", { className: alarm.severity },
      element("strong", { textContent: isAlarm ? "ALARM" : "Warning" }),
      element("p", {}, `${who}${alarm.text}. `, element("b", { textContent: alarm.instruction })), button);
    row.setAttribute("role", isAlarm ? "alert" : "status");
    this.rows.set(key, row);
    const place = isAlarm ? byId("alarms").firstChild : byId("alarms").querySelector(".warning");
    byId("alarms").insertBefore(row, place ?? byId("sound"));
  }
}

/** Browsers let a page sound after a person has clicked or pressed a key on it. */
class Sound {
  /** @param {() => void} changed is called when sound is turned on or off */
  constructor(changed) {
    /** @type {AudioContext | null} */
    this.context = null;
    this.timer = 0;
    this.changed = changed;
    for (const kind of ["pointerdown", "keydown"]) document.addEventListener(kind, () => this.unlock(), { capture: true });
  }

  get isOn() {
    return this.context?.state === "running";
  }

  async unlock() {
    if (this.isOn) return;
    this.context ??= new AudioContext();
    this.context.onstatechange = () => this.changed();
    try {
      await this.context.resume();
    } catch {
      // no sound here; the page shows that
    }
    this.changed();
  }

  /** @param {boolean} on */
  play(on) {
    if (on === Boolean(this.timer)) return;
    clearInterval(this.timer);
    this.timer = on ? setInterval(() => this.once(), SOUND_EVERY_MS) : 0;
    if (on) this.once();
  }

  once() {
    if (!this.isOn || !this.context) return;
    for (const [hertz, after] of TONES) {
      const [tone, volume] = [this.context.createOscillator(), this.context.createGain()];
      const start = this.context.currentTime + after;
      tone.type = "square";
      tone.frequency.value = hertz;
      volume.gain.value = 0.2;
      tone.connect(volume).connect(this.context.destination);
      tone.start(start);
      tone.stop(start + TONE_S);
    }
    byId("alarms").dataset.sounded = String(Number(byId("alarms").dataset.sounded ?? 0) + 1);
  }
}
