// Elements in one line.

/** @param {string} tag @param {Record<string, any>} [properties]
 *  @param {...(Node | string)} children @returns {any} */
export function element(tag, properties = {}, ...children) {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
}

/** Show a text, unless it stands there already. @param {any} shown @param {string} text */
export function setText(shown, text) {
  if (shown.textContent !== text) shown.textContent = text;
}

/** @param {string} id @returns {any} */
export function byId(id) {
  return document.getElementById(id);
}

/** A labelled field for a number. @param {string} label @param {number | null} value
 *  @param {(value: number) => void} changed @param {string} [placeholder] */
export function numberField(label, value, changed, placeholder = "") {
  const input = element("input", { type: "number", step: "any", min: "0", placeholder });
  input.value = value === null ? "" : String(value);
  input.addEventListener("change", () => {
    if (input.value !== "") changed(Number(input.value));
  });
  return element("label", { className: "field" }, element("span", { textContent: label }), input);
}
