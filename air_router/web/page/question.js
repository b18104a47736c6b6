// Questions that must be answered before something is done; the page has a dialog "question".

import { byId, element, numberIn, numberInput } from "./element.js";

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

/** Ask for a number. @param {string} title @param {string} label @param {{min: number, max: number, value: number}} range
 *  @param {string} yes the label of the button @returns {Promise<number | null>} null for none */
export async function number(title, label, range, yes) {
  const input = numberInput({ value: String(range.value) });
  const cancel = element("button", { textContent: "Cancel" });
  const ok = element("button", { textContent: yes, className: "main" });
  const done = () => {
    const value = numberIn(input, range);
    if (value !== undefined) byId("question").close(String(value));
  };
  cancel.addEventListener("click", () => byId("question").close());
  ok.addEventListener("click", done);
  input.addEventListener("keydown", (event) => {
    if (event.key !== "Enter") return;
    event.preventDefault(); // or the button that opened this is pressed again
    done();
  });
  const answer = await open(title, [element("label", {}, label, input)], [cancel, ok]);
  return answer === "" ? null : Number(answer);
}

/** Show a dialog. @param {string} title @param {Node[]} body @param {Node[]} buttons @returns {Promise<string>} */
export function open(title, body, buttons) {
  const dialog = byId("question");
  const row = element("div", { className: "row" }, ...buttons);
  dialog.replaceChildren(element("h2", { textContent: title }), ...body, row);
  dialog.returnValue = "";
  dialog.showModal();
  dialog.scrollTop = 0; // the button at its end has the focus
  return new Promise((resolve) => {
    dialog.addEventListener("close", () => resolve(dialog.returnValue), { once: true });
  });
}
