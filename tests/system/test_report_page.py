"""The report of a flight in a real browser: light, dark, on a phone; it requests nothing.

With DOCS_IMAGES=docs/images in the environment, and REPORT naming a report, its picture is taken.
"""

import os
from pathlib import Path

import pytest

from air_router.controller.model.actions import StateChanged
from air_router.controller.model.events import RobotPose
from air_router.controller.model.flight_setup import FlightSetup
from air_router.controller.model.states import Signal, State
from air_router.mission.loading import load_mission
from air_router.record.log import Note, RecordEntry
from air_router.report.flight_history import HistoryFold
from air_router.vehicle.vehicle import Telemetry
from geo.frame import Point
from mocha_link.links.metrics import Direction, SyncEnded
from tests.system.looker import Looker

pytestmark = pytest.mark.xdist_group("pages")

ROOT = Path(__file__).parents[2]
MISSION = ROOT / "missions" / "pennovation" / "mission.yaml"


def entries():
    yield RecordEntry(0.0, "action", StateChanged(State.READY, Signal.AIRBORNE, State.INIT, None))
    for t in range(100):
        place = Point(0.4 * t, 0.0)
        telemetry = Telemetry(float(t), place, 40.0, armed=True, in_air=True, battery=1 - t / 200)
        yield RecordEntry(t, "event", telemetry)
        yield RecordEntry(t, "event", SyncEnded("io", 1.7e9 + t, Direction.OUT, 1, 1000 * t, 0.1))
        yield RecordEntry(t, "note", Note("Map", {"known_cells": 10 * t}))
        for robot in ("io", "europa"):  # at one place
            yield RecordEntry(t, "event", RobotPose(robot, place, 1.7e9 + t, robot))


@pytest.fixture
def report(tmp_path):
    if "REPORT" in os.environ:
        return Path(os.environ["REPORT"])
    from air_router.report.flight_page import page_of  # noqa: PLC0415 - draws

    setup = FlightSetup(load_mission(MISSION), ("io", "europa"), name="titan")
    fold = HistoryFold(setup, {})
    for entry in entries():
        fold.take(entry)
    page = tmp_path / "report.html"
    page.write_text(page_of(fold.end("it was cut off"), "flight.mcap"), encoding="utf-8")
    return page


SMALL_TEXT = """
() => [...document.querySelectorAll('svg text')].filter((text) => text.checkVisibility())
  .map((text) => [text.textContent, text.getBoundingClientRect().height])
  .filter(([, height]) => height > 0 && height < 9.5)
"""
OVERLAPS = """
() => [...document.querySelectorAll('svg')].filter((svg) => svg.checkVisibility())
  .flatMap((svg) => {
    const texts = [...svg.querySelectorAll('text')]
    const boxes = texts.map((text) => [text.textContent, text.getBoundingClientRect()])
    const shares = (a, b) => Math.min(a.right, b.right) - Math.max(a.left, b.left) > 2
      && Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > 4
    return boxes.flatMap(([one, a], i) => boxes.slice(i + 1)
      .filter(([, b]) => shares(a, b)).map(([other]) => [svg.ariaLabel, one, other]))
  })
"""


@pytest.mark.parametrize(
    ("width", "shown", "scheme"),
    [(1440, "wide", "light"), (820, "wide", "dark"), (390, "narrow", "dark")],
)
def test_the_report_fits_every_screen_and_requests_nothing(report, browser, width, shown, scheme):
    page = browser.new_page()
    page.set_viewport_size({"width": width, "height": 860})
    page.emulate_media(color_scheme=scheme)
    looker = Looker(page, report.as_uri())
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    for section in ("track", "timeline", "bandwidth", "ages", "map", "distance", "battery"):
        pictures = page.locator(f"#{section} svg:visible")
        if section in FIGURES or pictures.count():
            assert pictures.count() == 1
            assert shown in pictures.first.get_attribute("class")
            assert pictures.first.bounding_box()["width"] > 0.8 * min(width, 1040) - 60
    assert page.evaluate(SMALL_TEXT) == []
    if "REPORT" not in os.environ:  # others may have more robots than room
        assert page.evaluate(OVERLAPS) == []
    paper = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert paper == ("rgb(241, 240, 234)" if scheme == "light" else "rgb(24, 32, 40)")
    if "DOCS_IMAGES" in os.environ and scheme == "light":
        page.set_viewport_size({"width": 1200, "height": 860})
        page.screenshot(path=Path(os.environ["DOCS_IMAGES"]) / "report.png", clip=SHOWN)
    page.close()
    assert looker.requested == [report.as_uri()]
    assert looker.faults == []


FIGURES = {"track", "timeline", "bandwidth", "distance", "battery"}
SHOWN = {"x": 80, "y": 0, "width": 1040, "height": 860}
