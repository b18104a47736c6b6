"""The live page's map and its buttons, as a person sees and presses them, in three sizes."""

import contextlib

import pytest

from air_router.controller.model.flight_setup import FlightSetup
from air_router.live.playback import RecordedFlight
from air_router.live.server import LivePage
from air_router.mission.loading import load_mission
from air_router.record.log import RecordEntry
from air_router.vehicle.vehicle import FlightMode, Telemetry
from geo.frame import Point
from tests.system.conftest import PENNOVATION
from tests.system.looker import Looker, served
from tests.system.page_checks import FITS, PALE_AMONG
from tests.system.test_map_pages import SIZES, Refusing, viewport

# Labels that cover another one, or the spot of a place.
COVERING = """() => {
  const box = (one) => one.getBoundingClientRect();
  const boxes = (selector) => [...document.querySelectorAll(selector)].map(box);
  const labels = boxes(".map-label");
  const over = (a, b) => Math.min(a.right, b.right) - Math.max(a.left, b.left) > 0.5
    && Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > 0.5;
  const after = (index) => labels.slice(index + 1);
  const pairs = labels.flatMap((one, index) => after(index).map((other) => [one, other]));
  const spots = boxes(".spot").flatMap((spot) => labels.map((label) => [spot, label]));
  return [...pairs, ...spots].filter(([a, b]) => over(a, b)).length;
}"""
NAMES = "() => [...document.querySelectorAll('.map-label')].map((one) => one.textContent)"
# Waypoints in the window beside which there is no number.
NAMELESS = """() => {
  if (document.querySelector(".leaflet-zoom-anim")) return -1;
  const box = (one) => one.getBoundingClientRect();
  const boxes = (selector) => [...document.querySelectorAll(selector)].map(box);
  const numbers = boxes(".waypoint-number");
  const near = (spot) => numbers.some(({ left, right, top, bottom }) => left - 4 < spot.right
    && right + 4 > spot.left && top - 4 < spot.bottom && bottom + 4 > spot.top);
  return boxes(".spot.waypoint").filter(({ left, right, top, bottom }) => left > 0 && top > 0
    && right < innerWidth && bottom < innerHeight).filter((spot) => !near(spot)).length;
}"""


def zoomed(way, until):
    """Zooms by steps until something holds; while one zoom moves, Leaflet takes no other."""
    return f"""() => {{
      if (document.querySelector(".leaflet-zoom-anim")) return false;
      const done = {until};
      if (!done) document.querySelector(".leaflet-control-zoom-{way}").click();
      return done;
    }}"""


@contextlib.contextmanager
def looking(browser, mission, **context):
    """A page of a vehicle of this mission in the air; gives it, and what is announced on it."""
    told = Telemetry(1.0, Point(0, 0), 40.0, armed=True, in_air=True, mode=FlightMode.MISSION)
    setup = RecordEntry(0.0, "setup", FlightSetup(mission, ("io",)))
    film = RecordedFlight([setup, RecordEntry(1.0, "event", told)])
    page = LivePage(film.controller, Refusing(), dict, mapper=film.mapper)
    film.go_on(2.0, page, 10)
    with served(page) as (address, _), contextlib.closing(browser.new_context(**context)) as own:
        looker = Looker(own.new_page(), address)
        looker.page.locator("path.area.fence").first.wait_for()
        yield looker, page
        assert looker.faults == []


@pytest.fixture(scope="module")
def named(browser):
    mission = load_mission(PENNOVATION)
    with looking(browser, mission) as (looker, _):
        yield looker.page, mission


@pytest.mark.parametrize("size", SIZES, ids=str)
def test_zones_and_waypoints_have_the_names_of_the_announcements(named, size):
    page, mission = named
    page.set_viewport_size(viewport(size))
    page.wait_for_function(FITS)
    zones = {zone.name for zone in mission.zones}
    waypoints = {str(waypoint.number) for waypoint in mission.waypoints}
    names = page.evaluate(NAMES)
    assert len(names) == len(set(names)) > 15
    assert set(names) <= zones | waypoints
    assert page.evaluate(COVERING) == 0
    for theme in ("light", "dark"):
        page.evaluate("(theme) => { document.documentElement.dataset.theme = theme; }", theme)
        assert page.evaluate(PALE_AMONG, ".map-label") == []
    if size == SIZES[0]:
        assert zones <= set(names)


def test_names_come_and_go_with_the_room_for_them(named):
    page, mission = named
    page.set_viewport_size(viewport(SIZES[-1]))
    page.wait_for_function(FITS)
    fitted = len(page.evaluate(NAMES))
    assert page.evaluate(NAMELESS) > 0  # there is no room for all
    page.wait_for_function(zoomed("in", f"({NAMELESS})() === 0"))
    assert page.evaluate(COVERING) == 0
    page.wait_for_function(zoomed("out", f"({NAMES})().length < {fitted / 2}"))
    assert page.locator(".spot.waypoint").count() == len(mission.waypoints)
    page.keyboard.press("f")
