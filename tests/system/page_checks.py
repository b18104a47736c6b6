"""What is checked of a page in the browser: whether it can be seen, read and pressed."""

# What covers the middle or a corner of an element that should be seen, or is cut off in it.
HIDDEN = """(selectors) => selectors.filter((selector) => {
  const shown = document.querySelector(selector);
  const { left, right, top, bottom } = shown.getBoundingClientRect();
  const middle = [(left + right) / 2, (top + bottom) / 2];
  const spots = [[left + 5, top + 5], [right - 5, bottom - 5], middle];
  return right - left < 5 || shown.scrollWidth > shown.clientWidth + 1
    || !spots.every(([x, y]) => shown.contains(document.elementFromPoint(x, y)));
})"""
# Whether the fence is where the map is free.
FITS = """() => {
  const free = document.getElementById("free").getBoundingClientRect();
  const fence = document.querySelector("path.area.fence").getBoundingClientRect();
  return fence.left >= free.left && fence.right <= free.right
    && fence.top >= free.top && fence.bottom <= free.bottom && fence.width > 60;
}"""
# Of a canvas, from a copy: a browser warns of one that is drawn and read by turns.
PIXELS = """const pixels = (canvas) => {
  const { width, height } = canvas;
  const copy = new OffscreenCanvas(width, height).getContext("2d", { willReadFrequently: true });
  copy.drawImage(canvas, 0, 0);
  return copy.getImageData(0, 0, width, height).data;
};"""
IS_PLOTTED = f"""() => {{
  {PIXELS}
  const canvas = document.getElementById("plots");
  const colours = new Set(new Uint32Array(pixels(canvas).buffer));
  return canvas.width > 100 && colours.size > 20;
}}"""
# Cards and controls that overlap, or leave the page; buttons that are covered, cut off at the side
# of their box, or have no text or no reason. What is scrolled out of its box is ignored.
CROWDED = """() => {
  const box = (one) => one.getBoundingClientRect();
  const seen = (one) => one.checkVisibility() && box(one).width > 0;
  const name = (one) => one.id || one.dataset.verb || one.className || one.textContent;
  const cards = [...document.querySelectorAll("#layout .card, .leaflet-control")].filter(seen);
  const wrong = [];
  cards.forEach((one, index) => {
    const a = box(one);
    if (a.left < 0 || a.top < 0 || a.right > innerWidth || a.bottom > innerHeight)
      wrong.push(`${name(one)} beyond the edge`);
    for (const other of cards.slice(index + 1)) {
      const b = box(other);
      const across = Math.min(a.right, b.right) - Math.max(a.left, b.left);
      const down = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
      if (across > 1 && down > 1) wrong.push(`${name(one)} over ${name(other)}`);
    }
  });
  for (const one of [...document.querySelectorAll("button, select, summary")].filter(seen)) {
    const { left, right, top, bottom } = box(one);
    const [x, y] = [(left + right) / 2, (top + bottom) / 2];
    let scrolled = false;
    for (let around = one.parentElement; around; around = around.parentElement) {
      const inner = box(around);
      if (getComputedStyle(around).overflow === "visible") continue;
      scrolled ||= y < inner.top || y > inner.bottom;
      if (!around.matches("#tabs, #tools") && (left < inner.left - 1 || right > inner.right + 1))
        wrong.push(`${name(one)} is cut off`);
    }
    const top_one = document.elementFromPoint(x, y);
    if (!scrolled && !one.contains(top_one)) wrong.push(`${name(one)} is covered`);
    if (!one.title && !one.ariaLabel && !one.textContent.trim()) wrong.push("a nameless button");
    const refused = one.disabled || one.ariaDisabled === "true";
    if (refused && !one.title) wrong.push(`${name(one)} has no reason`);
  }
  return wrong;
}"""
# Texts that are hard to read on what is behind them (WCAG: 4.5 to 1).
PALE_AMONG = """(selector) => {
  const rgb = (text) => text.match(/[0-9.]+/g).map(Number);
  const light = ([r, g, b]) => {
    const [x, y, z] = [r, g, b].map((of255) => ((of255 / 255 + 0.055) / 1.055) ** 2.4);
    return 0.2126 * x + 0.7152 * y + 0.0722 * z + 0.05;
  };
  const behind = (one) => {
    for (let around = one; around; around = around.parentElement) {
      const [r, g, b, alpha = 1] = rgb(getComputedStyle(around).backgroundColor);
      if (alpha > 0.9) return [r, g, b];
    }
    return rgb(getComputedStyle(document.body).backgroundColor);
  };
  const hasText = (node) => node.nodeType === Node.TEXT_NODE && node.data.trim();
  return [...document.querySelectorAll(selector)].filter((one) => one.checkVisibility()
    && !one.closest(":disabled, [aria-disabled=true]")
    && [...one.childNodes].some(hasText)).map((one) => {
      const [a, b] = [light(rgb(getComputedStyle(one).color)), light(behind(one))];
      return [Math.max(a, b) / Math.min(a, b), one.textContent.trim()];
    }).filter(([ratio]) => ratio < 4.5).map(([ratio, text]) => `${text}: ${ratio.toFixed(1)}`);
}"""
# Of those, the ones in the furniture.
PALE = f"() => ({PALE_AMONG})('#layout .card *')"
