"""The report of a flight in a real browser: light, dark, on a phone; it asks for nothing.

With DOCS_IMAGES=docs/images in the environment, and REPORT naming a report, its picture is taken.
"""

import os
from pathlib import Path

import pytest

from air_router.controller.model.actions import StateChanged
from air_router.controller.model.flight_setup import FlightSetup
from air_router.controller.model.states import Signal, State
from air_router.mission.loading import load_mission
from air_router.record.log import Note, RecordEntry
from air_router.report.flight_page import page_of
from air_router.report.flight_summary import summary_of
from air_router.vehicle.vehicle import Telemetry
from geo.frame import Point
from mocha_link.links.metrics import Direction, SyncEnded
from tests.system.looker import Looker

ROOT = Path(__file__).parents[2]
MISSION = ROOT / "missions" / "pennovation" / "mission.yaml"


def entries():
    yield RecordEntry(0.0, "setup", FlightSetup(load_mission(MISSION), ("io",), name="titan"))
    yield RecordEntry(0.0, "action", StateChanged(State.READY, Signal.AIRBORNE, State.INIT, None))
    for t in range(100):
        place = Point(0.4 * t, 0.0)
        told = Telemetry(float(t), place, 40.0, armed=True, in_air=True, battery=1 - t / 200)
        yield RecordEntry(t, "event", told)
        yield RecordEntry(t, "event", SyncEnded("io", 1.7e9 + t, Direction.OUT, 1, 1000 * t, 0.1))
        yield RecordEntry(t, "note", Note("Map", {"known_cells": 10 * t}))


@pytest.fixture
def report(tmp_path):
    if "REPORT" in os.environ:
        return Path(os.environ["REPORT"])
    summary = summary_of(entries())
    summary.end("it was cut off")
    page = tmp_path / "report.html"
    page.write_text(page_of(summary, "flight.mcap"), encoding="utf-8")
    return page


def test_the_report_fits_every_screen_and_asks_for_nothing(report, browser):
    page, papers = browser.new_page(), set()
    looker = Looker(page, report.as_uri())
    for width, shown, scheme in ((1200, "wide", "light"), (390, "narrow", "dark")):
        page.set_viewport_size({"width": width, "height": 860})
        page.emulate_media(color_scheme=scheme)
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        pictures = page.locator("#timeline svg:visible")
        assert pictures.count() == 1
        assert shown in pictures.first.get_attribute("class")
        box = page.locator("#bandwidth svg:visible").bounding_box()
        assert box["width"] > 0.8 * width - 220
        # A label is as large as one can read.
        text = page.locator("#bandwidth svg:visible text").first.bounding_box()
        assert text["height"] > 10
        papers.add(page.evaluate("getComputedStyle(document.body).backgroundColor"))
        if "DOCS_IMAGES" in os.environ and scheme == "light":
            folder = Path(os.environ["DOCS_IMAGES"])
            page.screenshot(path=folder / "report.png", clip=SHOWN)
    page.close()
    assert len(papers) == 2
    assert looker.asked == [report.as_uri()]
    assert looker.faults == []


SHOWN = {"x": 80, "y": 0, "width": 1040, "height": 860}
