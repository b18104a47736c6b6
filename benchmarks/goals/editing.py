"""The edit page with a large mission: from a key to the screen, in a browser.

Another key each second moves a waypoint by a metre. The time runs from the key until the frame is
over in which the page has drawn what the program answered: places, graph, legs and problems.
"""

import contextlib
import importlib.util
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from benchmarks.browser import chromium
from benchmarks.fleet.processes import HERE
from benchmarks.goals.figure import Conditions, Figure, UnmeasuredError
from benchmarks.route.maps import made
from benchmarks.routing import mission_text
from mocha_link.team.document import Document

WAYPOINTS, ZONES, KEYS = 500, 100, 12
GOAL_MS, LIMIT_MS, PAUSE_MS = 150, 120_000, 1000
OPTIONS = ("--no-sandbox", "--disable-gpu", "--disable-background-networking")
# `took`: for each key, until the frame after the page has taken the new state. A bare page takes
# what any page takes: a key, a line of text, a frame.
WATCH = """
globalThis.took = [];
let pressed = null;
addEventListener("keydown", (event) => (pressed = event.timeStamp), { capture: true });
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
    """The median and the slowest of a dozen keys."""
    path = chromium()
    if path is None or importlib.util.find_spec("playwright") is None:
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
            playwright.chromium.launch(executable_path=path, args=list(OPTIONS))
        ) as browser,
    ):
        bare = browser.new_page()
        bare.add_init_script(WATCH)
        page_file = Path(folder, "bare.html")
        page_file.write_text(BARE, encoding="utf-8")
        bare.goto(page_file.as_uri())
        bare_ms = statistics.median(_keys(bare))
        path = Path(folder, "mission.yaml")
        path.write_text(text, encoding="utf-8")
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.set_default_timeout(LIMIT_MS)
        page.add_init_script(WATCH)
        with _edited(path) as address:
            page.goto(address)
            page.wait_for_selector(".place.waypoint")
            page.keyboard.press("n")
            took_ms = _keys(page)
    where = f"{waypoints} waypoints x {zones} zones"
    anchors = {"a key on a bare page": bare_ms, "reading its YAML": read_ms}
    yield Figure(
        f"{where}: key to screen", statistics.median(took_ms), "ms", GOAL_MS, anchors=anchors
    )
    yield Figure(f"{where}: slowest key", max(took_ms), "ms", GOAL_MS, anchors=anchors)


def _keys(page: Any) -> list[float]:
    """How long each key took; the first one, when much is new, is not counted."""
    for number in range(KEYS + 1):
        page.keyboard.press(("ArrowUp", "ArrowDown")[number % 2])
        page.wait_for_function("(count) => took.length > count", arg=number, polling=100)
        page.wait_for_timeout(PAUSE_MS)
    took_ms: list[float] = page.evaluate("took")
    return took_ms[1:]


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
            assert program.stdout is not None  # noqa: S101 - it was asked for
            yield program.stdout.readline().strip()
        finally:
            program.terminate()
