// One timeline for the slider of a recorded flight, the plots, and the marks of what was decided.

import { byId, setText } from "/page/element.js";
import { colour } from "/page/theme.js";

const ROW_PIXELS = 38;
const TOP_PIXELS = 16;
const ROBOT_COLOURS = 8;
const T = 0;
const LINKS = 5;

/** What is plotted: name, unit, values of a row (of each line one), from where the axis begins.
 *  @type {[string, string, (row: any[], peers: string[]) => (number | null | undefined)[], number | null][]} */
const PLOTS = [
  ["altitude", " m", (row) => [row[1]], 0],
  ["speed", " m/s", (row) => [row[2]], 0],
  ["battery", "%", (row) => [row[3] === null ? null : 100 * row[3]], 0],
  ["clearance", " m", (row) => [row[4]], 0],
  ["signal", "", (row, peers) => peers.map((peer) => row[LINKS][peer]?.[0]), null],
  ["data", " kB", (row, peers) => [peers.reduce((sum, peer) => sum + (row[LINKS][peer]?.[2] ?? 0), 0) / 1000], 0],
];

export class Timeline {
  /** @param {() => import("./flight.js").Flight} chosen whose time it is */
  constructor(chosen) {
    this.chosen = chosen;
    this.paused = false;
    this.dragged = false;
    /** @type {number | null} the time under the pointer */
    this.pointed = null;
    this.canvas = byId("plots");
    byId("pause").addEventListener("click", () => this.ask({ ask: "pause", paused: !this.paused }));
    byId("speed").addEventListener("change", (event) => this.ask({ ask: "speed", speed: Number(event.target.value) }));
    byId("when").addEventListener("input", () => (this.dragged = true));
    byId("when").addEventListener("change", () => {
      this.dragged = false;
      this.ask({ ask: "go", to_s: Number(byId("when").value) });
    });
    byId("plot").addEventListener("click", () => this.toggle());
    this.canvas.addEventListener("pointermove", (event) => this.point(this.timeAt(event.offsetX)));
    this.canvas.addEventListener("pointerleave", () => this.point(null));
    this.canvas.addEventListener("click", (event) => {
      if (this.chosen().playback) this.ask({ ask: "go", to_s: this.timeAt(event.offsetX) });
    });
    new ResizeObserver(() => this.draw()).observe(byId("film"));
    document.addEventListener("theme", () => this.draw());
  }

  get isOpen() {
    return !this.canvas.hidden;
  }

  toggle() {
    this.canvas.hidden = this.isOpen;
    document.body.classList.toggle("plotted", this.isOpen);
    byId("plot").setAttribute("aria-pressed", String(this.isOpen));
    this.show();
  }

  /** Show the time of the chosen flight, and how it was until then. */
  show() {
    const film = this.chosen().playback;
    document.body.classList.toggle("recorded", Boolean(film));
    byId("film").hidden = !film && !this.isOpen;
    for (const part of byId("film").querySelectorAll(".of-record")) part.hidden = !film;
    if (film) this.showFilm(film);
    this.draw();
  }

  /** @param {{begin_s: number, end_s: number, now_s: number, speed: number, paused: boolean}} film */
  showFilm(film) {
    this.paused = film.paused;
    setText(byId("pause"), film.paused ? "▶" : "❚❚");
    byId("pause").setAttribute("aria-label", film.paused ? "Resume" : "Pause");
    const when = byId("when");
    [when.min, when.max] = [String(film.begin_s), String(film.end_s)];
    if (!this.dragged) when.value = String(film.now_s);
    setText(byId("clock"), `${film.now_s.toFixed(0)} s of ${film.end_s.toFixed(0)} s`);
    const speed = byId("speed");
    if (![...speed.options].some((one) => Number(one.value) === film.speed)) {
      speed.add(new Option(`${film.speed} ×`, String(film.speed)));
    }
    if (speed !== document.activeElement) speed.value = String(film.speed);
  }

  /** @param {number | null} pointed */
  point(pointed) {
    this.pointed = pointed;
    this.draw();
  }

  /** From when to when it reaches. @returns {[number, number]} */
  span() {
    const { playback: film, rows } = this.chosen();
    if (film) return [film.begin_s, film.end_s];
    return rows.length ? [rows[0][T], Math.max(rows.at(-1)[T], rows[0][T] + 60)] : [0, 60];
  }

  /** @param {number} pixels from the left @returns {number} */
  timeAt(pixels) {
    const [begin, end] = this.span();
    return begin + (Math.min(Math.max(pixels / this.canvas.clientWidth, 0), 1) * (end - begin));
  }

  draw() {
    if (!this.isOpen || byId("film").hidden) return;
    const { rows, marks, playback } = this.chosen();
    const peers = [...new Set(rows.flatMap((row) => Object.keys(row[LINKS])))].sort();
    const width = this.canvas.clientWidth;
    const height = TOP_PIXELS + PLOTS.length * ROW_PIXELS;
    const ratio = globalThis.devicePixelRatio || 1;
    [this.canvas.width, this.canvas.height] = [width * ratio, height * ratio];
    const context = this.canvas.getContext("2d");
    context.scale(ratio, ratio);
    context.font = `12px ${getComputedStyle(document.body).fontFamily}`;
    const [begin, end] = this.span();
    const x = (t) => ((t - begin) / (end - begin)) * width;
    this.drawMarks(context, marks, x, height);
    const now = this.pointed ?? playback?.now_s ?? rows.at(-1)?.[T] ?? begin;
    const at = rows.findLast((row) => row[T] <= now);
    PLOTS.forEach(([name, unit, of, least], index) => {
      const values = rows.map((row) => of(row, peers));
      const shown = at ? of(at, peers).filter((value) => value != null) : [];
      const text = shown.map((value) => Math.round(value * 10) / 10).join(", ");
      const units = new Set(at ? peers.map((peer) => at[LINKS][peer]?.[3]) : []);
      const behind = unit || ` ${[...units].filter(Boolean).join(", ")}`;
      context.fillStyle = colour("soft");
      context.textAlign = "left";
      context.fillText(`${name} ${text}${behind}`, 2, TOP_PIXELS + index * ROW_PIXELS + 11);
      const box = { top: TOP_PIXELS + index * ROW_PIXELS + 14, height: ROW_PIXELS - 18 };
      drawLines(context, rows, values, x, box, least, peers.length > 1 && values[0]?.length > 1);
    });
    context.strokeStyle = colour("ink");
    context.strokeRect(x(now), TOP_PIXELS, 0, height);
    this.canvas.setAttribute("aria-label", `Plots at ${now.toFixed(0)} s`);
  }

  /** @param {any} context @param {{t: number, kind: string, text: string}[]} marks
   *  @param {(t: number) => number} x @param {number} height */
  drawMarks(context, marks, x, height) {
    let free = 0;
    for (const mark of marks) {
      const at = x(mark.t);
      context.strokeStyle = colour(mark.kind === "answer" ? "accent" : "line");
      context.strokeRect(at, TOP_PIXELS - 4, 0, height);
      const text = mark.kind === "answer" ? "?" : mark.text.split(" → ").at(-1);
      if (at < free || context.measureText(text).width + at > this.canvas.clientWidth) continue;
      context.fillStyle = colour("soft");
      context.fillText(text, at + 2, 10);
      free = at + context.measureText(text).width + 8;
    }
  }

  /** @param {object} request */
  ask(request) {
    this.chosen().link.ask(request).catch(() => {}); // the page shows already that the connection is lost
  }
}

/** @param {any} context @param {any[][]} rows @param {(number | null | undefined)[][]} values of each row
 *  @param {(t: number) => number} x @param {{top: number, height: number}} box @param {number | null} least
 *  @param {boolean} each whether each line has a colour of its own */
function drawLines(context, rows, values, x, box, least, each) {
  const all = values.flat().filter((value) => value != null);
  const low = least ?? Math.min(...all);
  const high = Math.max(low + 1, ...all);
  const y = (value) => box.top + box.height * (1 - (value - low) / (high - low));
  context.strokeStyle = colour("line");
  context.strokeRect(0, box.top + box.height, x(rows.at(-1)?.[T] ?? 0), 0);
  for (let line = 0; line < (values[0]?.length ?? 0); line += 1) {
    context.strokeStyle = colour(each ? `r${line % ROBOT_COLOURS}` : "leg");
    context.lineWidth = 1.5;
    context.beginPath();
    let drawing = false;
    rows.forEach((row, index) => {
      const value = values[index][line];
      if (value == null) drawing = false;
      else if (drawing) context.lineTo(x(row[T]), y(value));
      else context.moveTo(x(row[T]), y(value));
      drawing = value != null;
    });
    context.stroke();
    context.lineWidth = 1;
  }
}
