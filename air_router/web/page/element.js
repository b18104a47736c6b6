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
 *  @param {(value: number | null) => void} changed @param {string} [placeholder]
 *  @param {boolean} [optional] whether there may be none */
export function numberField(label, value, changed, placeholder = "", optional = false) {
  const input = element("input", { type: "number", step: "any", min: "0", placeholder });
  input.value = value === null ? "" : String(value);
  input.addEventListener("change", () => {
    if (input.value !== "") changed(Number(input.value));
    else if (optional && !input.validity.badInput) changed(null);
  });
  return element("label", { className: "field" }, element("span", { textContent: label }), input);
}

/** A labelled field for a text. @param {string} label @param {string} value
 *  @param {(value: string) => void} changed @param {string} [placeholder] */
export function wordField(label, value, changed, placeholder = "") {
  const input = element("input", { className: "words", maxLength: 80, placeholder, value });
  input.addEventListener("change", () => changed(input.value.trim()));
  return element("label", { className: "field" }, element("span", { textContent: label }), input);
}
