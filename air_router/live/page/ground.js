// The map that UAVs paint: a canvas under everything, one pixel for each cell.

import { element } from "/page/element.js";

const L = globalThis.L;

/** Colours of the classes of ground, in the program's order; nothing for what is not known. */
const COLOURS = [
  [0, 0, 0, 0], // not known
  [138, 142, 150, 150], // road
  [72, 128, 76, 150], // vegetation
  [168, 110, 84, 160], // building
  [150, 184, 110, 130], // grass
  [206, 62, 72, 230], // vehicle
  [220, 60, 190, 230], // human
  [186, 164, 124, 140], // gravel
];

/** @typedef {{row: number, column: number, rows: number, columns: number, cells: string}} Piece
 *  @typedef {{bounds: number[][], rows: number, columns: number, piece: Piece | null}} Whole */

/** The maps of all flights; those of the same place are one. */
export class Grounds {
  /** @param {any} map */
  constructor(map) {
    this.map = map;
    /** Each with the flights that paint it. @type {Map<string, {ground: Ground, painters: Set<object>}>} */
    this.shown = new Map();
  }

  /** A flight's map anew. @param {object} flight @param {Whole} whole @returns {Ground} to add to */
  show(flight, whole) {
    const key = JSON.stringify([whole.bounds, whole.rows, whole.columns]);
    for (const [place, { ground, painters }] of this.shown) {
      if (!painters.delete(flight) || painters.size) continue;
      ground.remove();
      this.shown.delete(place);
    }
    const id = this.shown.size ? "" : "ground";
    const { ground, painters } = this.shown.get(key) ?? { ground: new Ground(this.map, id, whole), painters: new Set() };
    this.shown.set(key, { ground, painters: painters.add(flight) });
    ground.add(whole.piece);
    return ground;
  }
}

class Ground {
  /** @param {any} map @param {string} id @param {Whole} whole */
  constructor(map, id, whole) {
    const { columns: width, rows: height } = whole;
    this.canvas = element("canvas", { id, className: "ground", width, height });
    this.context = this.canvas.getContext("2d", { willReadFrequently: true });
    // An overlay of any element: Leaflet only names it after SVG.
    this.overlay = L.svgOverlay(this.canvas, whole.bounds, { pane: "backdrop", interactive: false }).addTo(map);
  }

  /** Paint what is known; the rest stays as others have painted it. @param {Piece | null} piece */
  add(piece) {
    if (!piece) return;
    const { row, column, rows, columns } = piece;
    const top = this.canvas.height - row - rows;
    const cells = Uint8Array.from(atob(piece.cells), (letter) => letter.charCodeAt(0));
    const image = this.context.getImageData(column, top, columns, rows);
    for (let from = 0; from < rows; from += 1) {
      const to = rows - 1 - from; // cells begin in the south, pixels in the north
      for (let x = 0; x < columns; x += 1) {
        const colour = COLOURS[cells[from * columns + x]];
        if (colour?.[3]) image.data.set(colour, 4 * (to * columns + x));
      }
    }
    this.context.putImageData(image, column, top);
  }

  remove() {
    this.overlay.remove();
  }
}
