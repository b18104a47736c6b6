// Lines every 10, 50, 100 ... metres, counted from a fixed place, drawn on one canvas.

import { colour } from "./theme.js";
import { offset } from "./map.js";

const L = globalThis.L;
const LEAST_PIXELS = 70;
const STEPS_M = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10000, 50000, 100000];

export const Grid = L.Layer.extend({
  onAdd(map) {
    this._map = map;
    this._canvas = L.DomUtil.create("canvas", "leaflet-layer", map.getPane("grid"));
    this._redraw = () => this.draw();
    map.on("moveend zoomend resize viewreset gridorigin", this._redraw);
    document.addEventListener("theme", this._redraw);
  },

  onRemove(map) {
    map.off("moveend zoomend resize viewreset gridorigin", this._redraw);
    document.removeEventListener("theme", this._redraw);
    this._canvas.remove();
  },

  /** The lines cover more than the view, so that a drag does not show their ends. */
  draw() {
    const map = this._map;
    const size = map.getSize();
    const pad = size.multiplyBy(0.5).round();
    const whole = size.add(pad.multiplyBy(2));
    const ratio = globalThis.devicePixelRatio || 1;
    const canvas = this._canvas;
    canvas.width = whole.x * ratio;
    canvas.height = whole.y * ratio;
    canvas.style.width = `${whole.x}px`;
    canvas.style.height = `${whole.y}px`;
    const corner = map.containerPointToLayerPoint(pad.multiplyBy(-1));
    L.DomUtil.setPosition(canvas, corner);
    const centre = map.getCenter();
    const here = [centre.lat, centre.lng];
    const metre = map.latLngToLayerPoint(offset(here, 1000, 0)).x - map.latLngToLayerPoint(here).x;
    const pixelsPerM = metre / 1000;
    const stepM = STEPS_M.find((step) => step * pixelsPerM >= LEAST_PIXELS);
    if (!stepM || !Number.isFinite(pixelsPerM)) return;
    const origin = map.options.gridOrigin ?? here;
    const start = map.latLngToLayerPoint(origin).subtract(corner);
    const step = stepM * pixelsPerM;
    const context = canvas.getContext("2d");
    context.scale(ratio, ratio);
    context.strokeStyle = colour("grid");
    context.lineWidth = 1;
    context.beginPath();
    for (let x = start.x % step; x < whole.x; x += step) {
      context.moveTo(Math.round(x) + 0.5, 0);
      context.lineTo(Math.round(x) + 0.5, whole.y);
    }
    for (let y = start.y % step; y < whole.y; y += step) {
      context.moveTo(0, Math.round(y) + 0.5);
      context.lineTo(whole.x, Math.round(y) + 0.5);
    }
    context.stroke();
  },
});
