"""The edit page with a large mission: from a key to the screen, in a browser.

Another key (or click) each second makes an edit. The time runs from the key until the frame is over
in which the page has drawn what the program answered: places, graph, legs and problems.
"""

import contextlib
import importlib.util
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from benchmarks.browser import chromium
from benchmarks.fleet.processes import HERE
from benchmarks.goals.figure import Conditions, Figure, UnmeasuredError
from benchmarks.route.maps import made, mission_text
from mocha_link.team import Document

WAYPOINTS, ZONES, KEYS = 500, 100, 12
GOAL_MS, LIMIT_MS, PAUSE_MS = 150, 120_000, 1000
OPTIONS = ("--no-sandbox", "--disable-gpu", "--disable-background-networking")
# `took`: for each key, until the frame after the page has taken the new state. A bare page takes
# what any page takes: a key, a line of text, a frame.
WATCH = """
globalThis.took = [];
let pressed = null;
for (const kind of ["keydown", "click"])
  addEventListener(kind, (event) => (pressed = event.timeStamp), { capture: true });
globalThis.drawn = () => {
  const from = pressed;
  if (from === null) return;
  pressed = null;
  requestAnimationFrame(() => setTimeout(() => took.push(performance.now() - from)));
};
globalThis.WebSocket = class extends WebSocket {
  set onmessage(take) {
    super.onmessage = (event) => {
      take(event);
      if (/^.{0,9}type.{0,4}state/.test(event.data)) drawn();
    };
  }
};
"""
BARE = """<p id=text></p><script>
let count = 0;
addEventListener("keydown", () => {
  document.getElementById("text").textContent = `key ${(count += 1)}`;
  drawn();
});
</script>"""


def measure(conditions: Conditions) -> Iterator[Figure]:
    """The median of a dozen keys for each kind of edit, and the slowest of all."""
    browser_path = chromium()
    if browser_path is None or importlib.util.find_spec("playwright") is None:
        raise UnmeasuredError("no Chromium, or no playwright")
    from playwright.sync_api import sync_playwright  # noqa: PLC0415 - only where installed

    waypoints, zones = (50, 10) if conditions.quick else (WAYPOINTS, ZONES)
    text = mission_text(made(waypoints, zones))
    began_s = time.process_time()
    Document.from_text(text, Path("mission.yaml"))
    read_ms = (time.process_time() - began_s) * 1e3
    with (
        tempfile.TemporaryDirectory() as folder,
        sync_playwright() as playwright,
        contextlib.closing(
            playwright.chromium.launch(executable_path=browser_path, args=list(OPTIONS))
        ) as browser,
    ):
        bare = browser.new_page()
        bare.add_init_script(WATCH)
        page_file = Path(folder, "bare.html")
        page_file.write_text(BARE, encoding="utf-8")
        bare.goto(page_file.as_uri())
        bare_ms = statistics.median(_timed(bare, _arrow(bare))[0])
        path = Path(folder, "mission.yaml")
        path.write_text(text, encoding="utf-8")
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.set_default_timeout(LIMIT_MS)
        page.add_init_script(WATCH)
        with _edited(path) as address:
            page.goto(address)
            page.wait_for_selector(".place.waypoint")
            took_ms = _edits(page)
    where = f"{waypoints} waypoints x {zones} zones"
    anchors = {"a key on a bare page": bare_ms, "reading its YAML": read_ms}
    for kind, times_ms in took_ms.items():
        median_ms = statistics.median(times_ms)
        yield Figure(f"{where}: {kind}", median_ms, "ms", GOAL_MS, anchors=anchors)
    slowest_ms = max(map(max, took_ms.values()))
    yield Figure(f"{where}: slowest key", slowest_ms, "ms", GOAL_MS, anchors=anchors)


def _edits(page: Any) -> dict[str, list[float]]:
    """How long each key took, by the kind of edit that it made."""
    press = page.keyboard.press

    def altitude(number: int) -> None:
        page.locator("#inspector input").fill(str(30 + number))
        page.wait_for_timeout(PAUSE_MS)
        press("Enter")

    def add(_: int) -> None:
        page.locator("#map").dispatch_event("click", {"clientX": 500, "clientY": 400})

    def remove(_: int) -> None:
        press("n")
        page.wait_for_timeout(PAUSE_MS)
        press("Delete")

    def undo(_: int) -> None:
        press("Control+z")

    took_ms: dict[str, list[float]] = {}
    press("n")
    (took_ms["key to screen"],) = _timed(page, _arrow(page))
    (took_ms["an altitude"],) = _timed(page, altitude)
    press("Escape")
    page.locator("path.area.zone").first.dispatch_event("click")
    page.locator(".corner").first.dispatch_event("click")
    (took_ms["a corner of a zone"],) = _timed(page, _arrow(page, "ArrowRight"))
    press("w")
    took_ms["a waypoint added"], undone_ms = _timed(page, add, undo)
    press("Escape")
    took_ms["a waypoint removed"], more_ms = _timed(page, remove, undo)
    took_ms["undone"] = undone_ms + more_ms
    return took_ms


def _arrow(page: Any, other: str = "ArrowDown") -> Callable[[int], None]:
    """There and back; with another arrow, never back to where areas and paths are known."""
    return lambda number: page.keyboard.press(("ArrowUp", other)[number % 2])


def _timed(page: Any, *edits: Callable[[int], None]) -> list[list[float]]:
    """How long each edit took, several times in turn; not counted the first, when much is new."""
    done = page.evaluate("took.length")
    for number in range(KEYS + 1):
        for edit in edits:
            edit(number)
            done += 1
            page.wait_for_function("(count) => took.length >= count", arg=done, polling=100)
            page.wait_for_timeout(PAUSE_MS)
    took_ms = page.evaluate("(count) => took.slice(-count)", KEYS * len(edits))
    return [took_ms[index :: len(edits)] for index in range(len(edits))]


@contextlib.contextmanager
def _edited(path: Path) -> Iterator[str]:
    """The program that edits a mission; gives the address of its page."""
    command = [sys.executable, "-m", "air_router.cli.cli", "edit", str(path)]
    with subprocess.Popen(  # noqa: S603 - ourselves
        [*command, "--port", "0", "--no-open"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        cwd=HERE,
        text=True,
    ) as program:
        try:
            assert program.stdout is not None  # noqa: S101 - it is a pipe
            yield program.stdout.readline().strip()
        finally:
            program.terminate()
