// Loads the page again when a part of it did not arrive, as when the network changed meanwhile.
// Not a module, and the first script: it must see that a module is missing.

const RELOAD_MS = 1000;

window.addEventListener(
  "error",
  (event) => {
    const from = event.target;
    if (from instanceof HTMLScriptElement || from instanceof HTMLLinkElement) {
      setTimeout(() => location.reload(), RELOAD_MS);
    }
  },
  true, // errors of elements do not bubble
);
