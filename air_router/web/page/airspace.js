// Fences and no-fly zones with the distances that are kept from them.

const L = globalThis.L;
const SMOOTH = 0.05; // pixels; with more, circles have corners

/** @typedef {{keys: (string | number)[] | null, name: string, fence: boolean, wrong: boolean,
 *   crosses: boolean, notes: string[], rings: {keys: (string | number)[], corners: number[][]}[],
 *   circle: {keys: (string | number)[], centre: number[], radius_m: number} | null,
 *   outline: number[][][][] | null, buffers: number[][][][][]}} Area */

export class AirspaceLayer {
  /** @param {any} map
   *  @param {(area: Area, event: any) => void} [pressed] is called for clicks ("contextmenu" too) */
  constructor(map, pressed) {
    this.map = map;
    this.pressed = pressed;
    /** @type {Map<string, {shape: any, buffers: any[], kind: string, area: Area}>} */
    this.drawn = new Map();
    this.svg = { areas: L.svg({ pane: "areas" }), buffers: L.svg({ pane: "buffers" }) };
  }

  /** @param {Area[]} areas all that there are now */
  show(areas) {
    const left = new Set(this.drawn.keys());
    areas.forEach((area, index) => {
      const key = area.keys ? JSON.stringify(area.keys) : `other ${index} ${area.name}`;
      left.delete(key);
      if (this.drawn.get(key)?.area === area) return; // as it is drawn
      const kind = area.circle && area.rings.length === 0 ? "circle" : "polygon";
      let entry = this.drawn.get(key);
      if (entry && entry.kind !== kind) {
        this.remove(key);
        entry = undefined;
      }
      entry ??= this.add(key, kind, area);
      this.update(entry, area);
    });
    left.forEach((key) => this.remove(key));
  }

  /** @param {string} key @param {string} kind @param {Area} area */
  add(key, kind, area) {
    const common = { renderer: this.svg.buffers, pane: "buffers", interactive: false, smoothFactor: SMOOTH };
    const sort = area.fence ? "fence" : "zone";
    const buffers = ["clearance", "margin"].map((name) =>
      L.polygon([], { ...common, className: `buffer ${sort} ${name}` }).addTo(this.map),
    );
    const options = { renderer: this.svg.areas, pane: "areas", bubblingMouseEvents: true, smoothFactor: SMOOTH };
    options.className = `area ${sort}`;
    const shape = kind === "circle" ? L.circle([0, 0], { ...options, radius: 1 }) : L.polygon([], options);
    shape.addTo(this.map);
    const entry = { shape, buffers, kind, area };
    this.drawn.set(key, entry);
    for (const name of ["click", "contextmenu"]) {
      shape.on(name, (event) => this.pressed?.(entry.area, event));
    }
    shape.bindTooltip(() => describe(entry.area), { sticky: true, opacity: 1, direction: "right", offset: [14, 0] });
    return entry;
  }

  /** @param {{shape: any, buffers: any[], kind: string, area: Area}} entry @param {Area} area */
  update(entry, area) {
    entry.area = area;
    if (entry.kind === "circle") {
      entry.shape.setLatLng(area.circle.centre).setRadius(area.circle.radius_m);
    } else {
      entry.shape.setLatLngs(area.outline ?? area.rings.map((ring) => ring.corners));
    }
    entry.buffers.forEach((buffer, index) => buffer.setLatLngs(area.buffers[index] ?? []));
    const element = entry.shape.getElement();
    if (element) {
      element.classList.toggle("wrong", area.wrong);
      element.classList.toggle("idle", area.notes.some((note) => !note.startsWith("clearance")));
      element.dataset.name = area.name;
    }
  }

  /** @param {string} key */
  remove(key) {
    const entry = this.drawn.get(key);
    entry.shape.remove();
    entry.buffers.forEach((buffer) => buffer.remove());
    this.drawn.delete(key);
  }
}

/** @param {Area} area @returns {HTMLElement} the tooltip */
function describe(area) {
  const box = document.createElement("div");
  box.append(Object.assign(document.createElement("strong"), { textContent: area.name }));
  for (const note of area.notes) {
    box.append(document.createElement("br"), note);
  }
  return box;
}
