"""The map pages as a user sees them: on a laptop, and on a phone held either way."""

import contextlib

import numpy as np
import pytest

from air_router.controller.model.flight_setup import FlightSetup
from air_router.editor.server import EditorServer
from air_router.editor.session import EditSession, MissionFile, write_starter
from air_router.live.joint import JointPage
from air_router.live.playback import Playback, RecordedFlight
from air_router.live.server import LivePage
from air_router.mission.loading import load_mission
from air_router.record.log import RecordEntry
from air_router.vehicle.vehicle import FlightMode, Telemetry
from air_router.web.serving import PageAddress, Web
from geo.frame import Geodetic, Point
from geo.grid import GridPatch, Terrain
from mocha_link.errors import RequestError
from mocha_link.links.metrics import Direction, LinkMetrics, SyncEnded, SyncStarted
from mocha_link.links.reading import Reading, Unit
from tests.system.looker import LIMIT_MS, Looker, served
from tests.system.page_checks import CROWDED, FITS, HIDDEN, IS_PLOTTED, PALE

pytestmark = pytest.mark.xdist_group("pages")

SIZES = ((1280, 720), (844, 390), (390, 844))
END_S = 300.0
HOME = Geodetic(39.9421, -75.1998)
AIR = (".leaflet-control-zoom", ".leaflet-control-scale", "#facts", "#free")


IS_STYLED = """() => [...document.querySelectorAll("link[rel=stylesheet]")].every((link) => {
  try {
    return link.sheet?.cssRules.length;
  } catch {
    return false; // it did not arrive
  }
})"""


class Refusing:
    """Refuses every request to a flight that is only watched."""

    def execute(self, command, by):
        raise RequestError(f"{by} requests {type(command).__name__}")


def viewport(size):
    return dict(zip(("width", "height"), size, strict=True))


@pytest.fixture(scope="module")
def mission(shared_folder):
    path = shared_folder / "field.yaml"
    write_starter(path, HOME)
    path.write_text(path.read_text(encoding="utf-8") + "altitudes_m: [30, 60]\n", encoding="utf-8")
    return load_mission(path)


@pytest.fixture(scope="module")
def record(mission):
    """Five minutes of flight in a circle; a robot takes the map after three."""
    entries = [RecordEntry(0.0, "setup", FlightSetup(mission, ("io", "callisto")))]
    for t in np.arange(0.0, END_S + 1.0):
        place = Point(60 * float(np.cos(t / 20)), 60 * float(np.sin(t / 20)))
        telemetry = Telemetry(
            float(t),
            place,
            40.0,
            (3.0, 0.0),
            heading_deg=90.0,
            armed=True,
            in_air=True,
            mode=FlightMode.HOLD,
            battery=1 - t / 600,
            voltage_v=15.8,
            satellites=14,
        )
        entries.append(RecordEntry(float(t), "event", telemetry))
        if t % 10 == 0:
            unit = Unit.DEVICE if t > 200 else Unit.DBM
            metrics = LinkMetrics(
                "io", signal=Reading(-50.0 - t / 10, unit, "x"), bytes_in=int(1000 * t)
            )
            entries.append(RecordEntry(float(t), "link", metrics))
        if t == 100:
            grid = RecordedFlight(entries).mapper.grid
            cells = np.full((20, 30), Terrain.ROAD, np.uint8)
            patch = GridPatch(grid.west_m + 40, grid.south_m + 40, 1.0, cells)
            entries.append(RecordEntry(float(t), "patch", patch.encode()))
        if t == 180:
            entries.append(RecordEntry(180.2, "event", SyncStarted("io", 0.0, Direction.OUT)))
            entries.append(
                RecordEntry(180.6, "event", SyncEnded("io", 0.0, Direction.OUT, 1, 9, 0.4))
            )
    return entries


@pytest.fixture(scope="module")
def replayed(browser, record):
    playback = Playback(RecordedFlight(record), Web())
    with served(playback) as (address, _):
        looker = Looker(browser.new_page(), address)
        looker.page.locator(".vehicle").wait_for()
        yield looker
        assert looker.strangers(address) == []
        assert looker.faults == []
        looker.page.close()


def go(looker, to_s):
    """Drag the slider of a recorded flight."""
    looker.page.evaluate(
        """(to) => { const when = document.getElementById("when");
        when.value = String(to); when.dispatchEvent(new Event("change")); }""",
        to_s,
    )
    looker.page.wait_for_function(
        "(to) => Math.abs(parseInt(document.getElementById('clock').textContent) - to) < 6",
        arg=to_s,
    )


def flight(record):
    """The page of a flight that is going on, at the end of the record."""
    film = RecordedFlight(record)
    page = LivePage(film.status, film.router, Refusing(), mapper=film.mapper)
    film.go_on(END_S, page, 10_000)
    return page


def editor(folder):
    path = folder / "edited.yaml"
    write_starter(path, HOME)
    return EditorServer(EditSession(MissionFile(path)))


@pytest.fixture(scope="module")
def pages(browser, record, shared_folder, replayed):
    """A page by its name: of a flight, of several, of a recorded one, of the editor."""
    with contextlib.ExitStack() as stack:

        def look(page):
            address, _ = stack.enter_context(served(page))
            looker = Looker(browser.new_page(), address)
            stack.callback(looker.page.close)
            looker.page.locator("path.area.fence").first.wait_for()
            return looker

        one, other = (stack.enter_context(served(flight(record)))[0] for _ in range(2))
        joint = JointPage(("titan", "atlas"))
        joint.found("titan", PageAddress.of(one))
        joint.found("atlas", PageAddress.of(other))
        shown = {"live": flight(record), "several": joint, "edit": editor(shared_folder)}
        lookers = {name: look(page) for name, page in shown.items()} | {"replay": replayed}
        yield {name: looker.page for name, looker in lookers.items()}
        assert [looker.faults for looker in lookers.values()] == [[], [], [], []]


@pytest.mark.parametrize("size", SIZES, ids=str)
@pytest.mark.parametrize("name", ["live", "several", "replay", "edit"])
def test_nothing_covers_anything_and_the_map_is_fitted_to_what_is_free(pages, name, size):
    page = pages[name]
    page.set_viewport_size(viewport(size))
    page.wait_for_function(FITS)
    for theme in ("light", "dark"):
        page.evaluate("(theme) => { document.documentElement.dataset.theme = theme; }", theme)
        assert page.evaluate(CROWDED) == []
        assert page.evaluate(PALE) == []
    rest = page.locator("#panel > :not(.stays)").last
    before = page.evaluate("document.getElementById('free').getBoundingClientRect().width")
    page.locator("#fold").click()
    page.wait_for_function(FITS)
    assert rest.is_hidden()
    assert page.evaluate(CROWDED) == []
    assert page.evaluate("document.getElementById('free').getBoundingClientRect().width") >= before
    page.locator("#fold").click()
    assert rest.is_visible()


@pytest.mark.parametrize("size", SIZES, ids=str)
def test_the_plots_cover_nothing(replayed, size):
    page = replayed.page
    page.set_viewport_size(viewport(size))
    # The page is laid out anew in the frame after its size has changed.
    all_shown = f"(selectors) => !({HIDDEN})(selectors).length"
    page.wait_for_function(all_shown, arg=[*AIR[:3], "#when", "#clock", "#panel h2"])
    assert "battery" in page.locator("#facts").inner_text()
    page.locator("#plot").click()
    page.wait_for_function(IS_PLOTTED)
    page.wait_for_function(all_shown, arg=AIR[:3])  # the map moves up in the frame after the plots
    assert page.evaluate(CROWDED) == []
    page.locator("#plot").click()
    assert page.locator("#plots").is_hidden()


@pytest.mark.parametrize("size", SIZES, ids=str)
def test_plots_beside_what_a_folded_panel_leaves_cover_nothing(pages, size):
    page = pages["live"]
    page.set_viewport_size(viewport(size))
    for button in ("#plot", "#fold"):
        page.locator(button).click()
    page.wait_for_function(IS_PLOTTED)
    page.wait_for_function(f"() => !({CROWDED})().length")
    for button in ("#plot", "#fold"):
        page.locator(button).click()


def test_a_long_dialog_begins_at_its_beginning(pages):
    page = pages["edit"]
    page.set_viewport_size(viewport(SIZES[1]))
    page.keyboard.press("?")
    dialog = page.locator("#question")
    assert dialog.evaluate("(one) => [one.scrollTop, one.scrollHeight > one.clientHeight]") == [
        0,
        True,
    ]
    page.keyboard.press("Escape")


def test_a_recorded_flight_that_goes_back_forgets_what_came_later(replayed):
    page, robots = replayed.page, replayed.page.locator("#robots")
    page.set_viewport_size({"width": 1280, "height": 720})
    go(replayed, 10)
    left = page.locator("#when").bounding_box()
    page.locator("#pause").click()
    go(replayed, 290)
    replayed.shows("#robots", "map 100%")
    page.wait_for_function("() => !document.querySelector('.link.lit, .signal.lit')")  # 2 min ago
    page.locator("#pause").click()
    assert page.locator("#when").bounding_box() == left
    go(replayed, 10)
    page.wait_for_function("() => !document.getElementById('robots').textContent.includes('map')")
    assert "no position received" in robots.inner_text()
    texts = page.locator("#vehicle").inner_text().split()
    assert texts[texts.index("heading") + 1] == "90°"
    assert {"14", "15.8"} <= set(texts)


def test_the_timeline_shows_what_was_and_takes_the_film_there(replayed):
    page = replayed.page
    page.set_viewport_size({"width": 1280, "height": 720})
    go(replayed, 10)
    page.locator("#plot").click()
    box = page.locator("#plots").bounding_box()
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + 60)
    replayed.shows("#clock", "15")
    replayed.shows("#clock", "of 300 s")
    page.locator("#links summary").click()
    replayed.shows("#links td", "-65 dBm")
    go(replayed, 250)
    replayed.shows("#links td", "-75 device")
    page.locator("#plot").click()


def test_the_legend_has_the_colours_of_the_map_in_light_and_dark(replayed):
    page = replayed.page
    page.locator("#legend summary").click()
    page.locator("#legend li").first.wait_for()
    seen = [
        page.evaluate(
            """(theme) => { document.documentElement.dataset.theme = theme;
            return ["#legend .area.fence", ".leaflet-areas-pane .area.fence"].map(
              (one) => getComputedStyle(document.querySelector(one)).stroke); }""",
            theme,
        )
        for theme in ("light", "dark")
    ]
    assert [len(set(strokes)) for strokes in seen] == [1, 1]
    assert seen[0] != seen[1]


def test_a_circle_is_round_and_buttons_have_the_reason_why_they_are_of_no_use(browser, record):
    film = RecordedFlight(record)
    page = LivePage(film.status, film.router, Refusing(), mapper=film.mapper)
    shown = page.scene.vehicle
    page.scene.vehicle = lambda status: {
        **shown(status),
        "state": "HOLD",
        "altitude_m": 40.2,
        "refused": {},
    }
    with served(page) as (address, end):
        looker = Looker(browser.new_page(viewport={"width": 844, "height": 390}), address)
        hold = looker.page.locator('[data-verb="hold"]')
        fence = looker.page.locator("path.area.fence")
        fence.wait_for()
        assert fence.get_attribute("d").count("L") > 40
        hold.click()
        looker.shows("#hint", "requests")
        assert looker.page.evaluate(HIDDEN, ["#hint", "#verbs"]) == []
        looker.page.locator('[data-verb="altitude"]').click()
        metres = looker.page.locator("dialog input")
        assert metres.input_value() == "40"
        metres.fill("90")
        metres.press("Enter")  # higher than the mission allows
        metres.fill("55")
        metres.press("Enter")
        looker.shows("#hint", "requests Altitude")
        end()
        looker.page.locator('[data-verb="hold"]:disabled').wait_for()
        assert hold.get_attribute("title") == "no connection to the flight"
        looker.shows("#why", "no connection")
        looker.page.close()


def test_a_round_fence_becomes_a_polygon_and_settings_are_set_on_a_phone(browser, tmp_path):
    path = tmp_path / "field.yaml"
    write_starter(path, HOME)
    with served(EditorServer(EditSession(MissionFile(path)))) as (address, _):
        looker = Looker(browser.new_page(viewport=viewport(SIZES[-1])), address)
        page = looker.page
        page.locator(".place.waypoint").wait_for()
        for size in (SIZES[-1], *SIZES):
            page.set_viewport_size(viewport(size))
            page.wait_for_function(FITS)
            assert page.evaluate(HIDDEN, [*AIR[:2], "#tools", "#save", "#panel h2"]) == []
        page.locator("#parts summary").click()
        page.locator("#list button", has_text="Fence").click()
        page.get_by_text("Make it a polygon").click()
        page.locator(".corner").nth(7).wait_for()
        page.locator("#settings summary").click()
        speed = page.locator('[data-setting="speed_m_s"] input')
        speed.fill("7")
        speed.press("Tab")
        page.locator("#save:not(:disabled)").click()
        page.locator("#save:disabled").wait_for()
        page.close()
        assert looker.faults == []
    text = path.read_text(encoding="utf-8")
    assert "  polygon:\n    - [39." in text
    assert "circle" not in text
    assert load_mission(path).speed_m_s == 7.0


@pytest.mark.parametrize("part", ["main.js", "page/map.js", "leaflet.js", "theme.css"])
@pytest.mark.parametrize("name", ["live", "edit"])
def test_a_page_of_which_a_part_did_not_arrive_is_loaded_again(
    browser, record, tmp_path, name, part
):
    """The browser gives up what it loads when the network changes; it requests nothing again."""
    shown = flight(record) if name == "live" else editor(tmp_path)
    with served(shown) as (address, _), contextlib.closing(browser.new_page()) as page:
        page.route(f"**/{part}", lambda route: route.abort("failed"), times=1)
        page.goto(address)
        page.locator("path.area.fence").first.wait_for(timeout=LIMIT_MS)
        page.wait_for_function(IS_STYLED, timeout=LIMIT_MS)
