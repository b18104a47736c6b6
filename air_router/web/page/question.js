// Questions that must be answered before something is done; the page has a dialog "question".

import { byId, element } from "./element.js";

/** Ask a question. @param {string} title @param {string} text
 *  @param {{label: string, value: string, main?: boolean}[]} choices
 *  @returns {Promise<string>} the value of the choice, "" for none */
export function question(title, text, choices) {
  const buttons = choices.map(({ label, value, main }) => {
    const button = element("button", { textContent: label, value, className: main ? "main" : "" });
    button.addEventListener("click", () => byId("question").close(value));
    return button;
  });
  const sentence = text[0].toUpperCase() + text.slice(1);
  return open(title, [element("p", { textContent: sentence })], buttons);
}

/** Show a dialog. @param {string} title @param {Node[]} body @param {Node[]} buttons @returns {Promise<string>} */
export function open(title, body, buttons) {
  const dialog = byId("question");
  const row = element("div", { className: "row" }, ...buttons);
  dialog.replaceChildren(element("h2", { textContent: title }), ...body, row);
  dialog.returnValue = "";
  dialog.showModal();
  return new Promise((resolve) => {
    dialog.addEventListener("close", () => resolve(dialog.returnValue), { once: true });
  });
}
