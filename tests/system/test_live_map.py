"""The live page's map and its buttons, as a person sees and presses them, in three sizes."""

import contextlib
import threading

import pytest

from air_router.controller.controller import Controller
from air_router.controller.model.flight_setup import FlightSetup
from air_router.controller.model.states import State
from air_router.flight.flight_loop import CommandService
from air_router.gossip.mapper import Mapper
from air_router.live.server import LivePage
from air_router.mission.loading import load_mission
from air_router.vehicle.vehicle import FlightMode, Telemetry
from air_router.web.fetch_command import TileArea, TileFetcher, bounds_around, fetch
from air_router.web.serving import HERE, Web
from air_router.web.tile_file import TileFile
from tests.air_router.web.test_tile_fetch import MapServer
from tests.system.conftest import PENNOVATION
from tests.system.looker import Looker, expect, served
from tests.system.page_checks import CROWDED, FITS, HIDDEN, PALE_AMONG
from tests.system.test_map_pages import SIZES, viewport

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
GROUNDS = """(selector) => [...document.querySelectorAll(selector)]
  .map((one) => getComputedStyle(one).backgroundColor)"""
ALL_SEEN = """() => [...document.querySelectorAll(".leaflet-backdrop-pane img")]
  .every((tile) => tile.naturalWidth === 256)"""
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


class Aloft:
    """A flight that has begun in the air; what is requested on its page is decided as in flight."""

    def __init__(self, mission, web=HERE):
        self.mission, self.now_s = mission, 0.0
        self.controller = Controller(FlightSetup(mission, ("io",)))
        service = CommandService(mission.frame, self.controller.status, self.take)
        self.page = LivePage(
            self.controller.status,
            lambda: self.controller.router,
            service,
            mapper=Mapper(mission),
            web=web,
        )
        armed = {"armed": True, "mode": FlightMode.MISSION}
        for more in ({"altitude_m": 0.0}, {"altitude_m": 0.0, **armed}, {"in_air": True, **armed}):
            self.now_s += 1.0
            self.take(Telemetry(self.now_s, mission.home, **{"altitude_m": 40.0, **more}))
        assert self.controller.state is State.INIT

    def take(self, event):
        decided = self.controller.handle(event, self.now_s)
        self.page.step(event, decided, self.now_s)
        return decided


@contextlib.contextmanager
def looking(browser, flight, **context):
    """A person who looks at a flight's page."""
    with (
        served(flight.page) as (address, _),
        contextlib.closing(browser.new_context(**context)) as own,
    ):
        looker = Looker(own.new_page(), address)
        looker.page.locator("path.area.fence").first.wait_for()
        yield looker
        assert looker.faults == []


@pytest.fixture(scope="module")
def named(browser):
    mission = load_mission(PENNOVATION)
    with looking(browser, Aloft(mission)) as looker:
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


def test_a_button_that_would_be_refused_has_its_reason_and_requests_nothing(browser):
    flight = Aloft(load_mission(PENNOVATION))
    with looking(browser, flight, viewport=viewport(SIZES[0])) as looker:
        page = looker.page

        def button(verb):
            return page.locator(f'[data-verb="{verb}"]')

        reasons = {
            "resume": "nothing is held: it is in INIT",
            "land": "it lands where it hovers: request 'hold' first",
            "altitude": "only 40 m above home is flown; 'altitudes_m' in the mission allows others",
        }
        for verb, why in reasons.items():
            expect(button(verb)).to_be_disabled()
            expect(button(verb)).to_have_attribute("title", why)
            expect(button(verb)).to_have_accessible_description(why)
            button(verb).dispatch_event("click")  # as a finger does
            looker.shows("#hint", f"Not now: {why}.")
            assert page.locator("dialog[open]").count() == 0
        for verb in ("hold", "explore", "goto", "home"):
            expect(button(verb)).to_be_enabled()
        expect(page.locator("#robots button")).to_be_enabled()
        assert page.evaluate(CROWDED) == []
        looker.request(button("hold").click)
        expect(button("resume")).to_be_enabled()
        assert button("resume").get_attribute("title") == ""
        expect(button("altitude")).to_be_disabled()
        late = (
            "sockets.at(-1).send(JSON.stringify({ request: 'altitude', altitude_m: 50, id: 99 }))"
        )
        answer = looker.request(lambda: page.evaluate(late))  # it was on its way before
        assert f"refused: {reasons['altitude']}" in answer


@pytest.mark.parametrize("size", SIZES[1:], ids=str)
def test_points_that_were_chosen_with_a_finger_are_cancelled_with_a_finger(browser, size):
    flight = Aloft(load_mission(PENNOVATION))
    with looking(browser, flight, viewport=viewport(size), has_touch=True) as looker:
        page = looker.page
        goto, cancel = page.locator('[data-verb="goto"]'), page.get_by_role("button", name="Cancel")
        expect(cancel).to_have_count(0)
        for way_out in (cancel.tap, lambda: page.keyboard.press("Escape")):
            goto.tap()
            expect(cancel).to_be_visible()
            page.touchscreen.tap(size[0] / 3, size[1] / 2)
            expect(page.locator(".wanted")).to_have_count(1)
            expect(goto).to_have_text("Fly there")
            assert page.evaluate(HIDDEN, ["#cancel"]) == []
            assert page.evaluate(CROWDED) == []
            way_out()
            expect(page.locator(".wanted")).to_have_count(0)
            expect(goto).to_have_text("Go to …")
            expect(cancel).to_have_count(0)
        assert flight.controller.state is State.INIT


def test_a_ground_that_was_fetched_is_shown_offline_with_whom_to_name(browser, tmp_path):
    mission, path = load_mission(PENNOVATION), tmp_path / "site.mbtiles"
    with MapServer() as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        fetcher = TileFetcher(server.template, 10.0, pause=lambda _: None)
        area = TileArea(bounds_around(mission, 200.0), range(16, 18))
        fetched = fetch(path, area, fetcher, "© City of P.")
        server.shutdown()
        thread.join()
    assert fetched.new == len(area)
    flight = Aloft(mission, Web(tiles=TileFile.read(path)))  # the server is gone
    with looking(browser, flight, viewport=viewport(SIZES[-1])) as looker:
        page = looker.page
        page.locator(".leaflet-backdrop-pane img").first.wait_for()
        page.wait_for_function(ALL_SEEN)
        name = page.locator(".leaflet-control-attribution")
        expect(name).to_have_text("© City of P.")
        expect(name).to_be_in_viewport()
        page.wait_for_function(FITS)
        page.wait_for_function(f"() => !({CROWDED})().length")
        named = ".map-label, .leaflet-control-attribution"  # readable on any picture
        for theme in ("light", "dark"):
            page.evaluate("(theme) => { document.documentElement.dataset.theme = theme; }", theme)
            assert page.evaluate(PALE_AMONG, named) == []
            assert "rgba(0, 0, 0, 0)" not in page.evaluate(GROUNDS, named)
        address = page.url
        assert looker.strangers(address) == []
