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

/** The number that a person wrote, with a point or a comma before its decimals, in every locale.
 *  A browser's own number field reads "40,5" as 405 in some locales and as nothing in others.
 *  @param {string} text @param {{min?: number, max?: number}} [range] both may be reached
 *  @returns {{value: number} | {error: string}} */
export function readNumber(text, { min = -Infinity, max = Infinity } = {}) {
  const written = text.trim();
  const [, whole, mark, decimals] = /^([+-]?\d+)(?:([.,])(\d+))?$/.exec(written) ?? [];
  if (whole === undefined) return { error: `"${written}" is not a number: write it like 40 or 40.5` };
  if (mark === "," && decimals.length === 3) {
    return { error: `"${written}" is ambiguous: ${whole}${decimals} or ${whole}.${decimals}; write one of these` };
  }
  const value = Number(mark === undefined ? whole : `${whole}.${decimals}`);
  if (value < min) return { error: `"${written}" is less than ${min}` };
  return value > max ? { error: `"${written}" is more than ${max}` } : { value };
}

/** A field that takes a number, with a point or a comma. @param {Record<string, any>} [properties] */
export function numberInput(properties = {}) {
  const input = element("input", { type: "text", inputMode: "decimal", autocomplete: "off", ...properties });
  input.addEventListener("input", () => input.setCustomValidity(""));
  return input;
}

/** The value of a number field; an invalid text is reported to the user and has no value.
 *  @param {any} input @param {{min?: number, max?: number}} [range] @returns {number | undefined} */
export function numberIn(input, range) {
  const read = readNumber(input.value, range);
  input.setCustomValidity("error" in read ? read.error : "");
  if ("error" in read) {
    input.reportValidity();
    return undefined;
  }
  input.value = String(read.value);
  return read.value;
}

/** A labelled field for a number. @param {string} label @param {number | null} value
 *  @param {(value: number | null) => void} changed @param {string} [placeholder]
 *  @param {boolean} [optional] whether there may be none */
export function numberField(label, value, changed, placeholder = "", optional = false) {
  const input = numberInput({ placeholder });
  input.value = value === null ? "" : String(value);
  input.addEventListener("change", () => {
    if (input.value.trim() === "") {
      if (optional) changed(null);
      return;
    }
    const read = numberIn(input, { min: 0 });
    if (read !== undefined) changed(read);
  });
  return element("label", { className: "field" }, element("span", { textContent: label }), input);
}

/** A labelled field for a text. @param {string} label @param {string} value
 *  @param {(value: string) => void} changed @param {string} [placeholder] */
export function wordField(label, value, changed, placeholder = "") {
  const input = element("input", { className: "text", maxLength: 80, placeholder, value });
  input.addEventListener("change", () => changed(input.value.trim()));
  return element("label", { className: "field" }, element("span", { textContent: label }), input);
}
