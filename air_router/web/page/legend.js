// The legend: each sign has the class, and so the colour, that it has on the map.

import { element } from "./element.js";

const SVG = "http://www.w3.org/2000/svg";
const SHAPES = {
  line: "M1 8H29",
  area: "M2 2H28V14H2Z",
  spot: "M15 3.5a4.5 4.5 0 1 1 0 9a4.5 4.5 0 1 1 0 -9",
  arrow: "M15 1 21 15 15 12 9 15Z",
};

/** @typedef {[keyof typeof SHAPES, string, string]} Sign shape, classes and label */

/** Signs of both pages. @type {Sign[]} */
export const MISSION = [
  ["line", "area fence", "fence"],
  ["area", "area zone", "no-fly zone"],
  ["area", "area zone idle", "inactive zone"],
  ["line", "buffer zone", "required clearance"],
  ["line", "buffer zone margin", "clearance plus tracking margin"],
  ["line", "edge", "clear connection"],
  ["spot", "spot", "waypoint"],
  ["spot", "spot home", "home"],
  ["spot", "spot rally", "rally point"],
];

/** The list is filled when it is opened. @param {any} details with a list @param {Sign[]} signs */
export function addLegend(details, signs) {
  details.addEventListener("toggle", () => show(details.querySelector("ul"), signs), { once: true });
}

/** @param {HTMLElement} list @param {Sign[]} signs */
function show(list, signs) {
  list.replaceChildren(...signs.map(([shape, classes, label]) => {
    const svg = document.createElementNS(SVG, "svg");
    svg.setAttribute("viewBox", "0 0 30 16");
    const path = document.createElementNS(SVG, "path");
    path.setAttribute("class", classes);
    path.setAttribute("d", SHAPES[shape]);
    svg.append(path);
    return element("li", {}, svg, label);
  }));
}
