// Whether what a flight tells can be drawn: on one map, an invalid position would stop all others.

/** @param {any} at a place in degrees @throws {TypeError} it is none */
export function checkPlace(at) {
  if (!Array.isArray(at) || at.length !== 2 || !at.every(Number.isFinite)) throw new TypeError("not a position");
}

/** @param {any} nested lists of lists, in the end of places @throws {TypeError} it is something else */
export function checkPlaces(nested) {
  if (Array.isArray(nested) && !nested.some(Number.isFinite)) nested.forEach(checkPlaces);
  else checkPlace(nested);
}
