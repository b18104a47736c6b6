"""The first promise of the README: one command, and a whole communication-aware flight.

The field is small, so that all robots are soon met. A browser looks on at the same flight, where
there is one. With DOCS_IMAGES=docs/images in the environment the pictures of docs/watching.md are
taken anew, of missions/pennovation.
"""

import json
import os
import re
from functools import cached_property
from pathlib import Path

import pytest

from air_router.control.control import ControlClient
from air_router.controller.model.actions import CommandAck, Seeking, StateChanged
from air_router.controller.model.requests import SeekNow
from air_router.controller.model.states import State
from air_router.mission.loading import load_mission
from air_router.record.log import Log
from air_router.record.replay import replay_record
from mocha_link import Team
from mocha_link.links.metrics import Direction, SyncEnded
from sitl.team.derived_team import derive_team
from tests.system.conftest import PENNOVATION
from tests.system.looker import Looker
from tests.system.page_checks import PIXELS

pytestmark = pytest.mark.xdist_group("flights 2")

PICTURED = "DOCS_IMAGES" in os.environ
SPEED = 12
ROBOTS = {"callisto", "europa", "io"}
MISSION = """\
name: Field
coordinates: local
frame: {origin: [39.9421523, -75.1997644]}
home: {position: [0, 0], altitude_amsl_m: 7}
altitude_m: 20
speed_m_s: 7
waypoints: [[0, 20], [30, 20], [30, -20], [-30, -20], [-30, 20]]
fence: [[-60, -50], [60, -50], [60, 50], [-60, 50]]
no_fly_zones:
  - {name: hall, polygon: [[10, 4], [20, 4], [20, 11], [10, 11]]}
  - {name: mast, circle: {centre: [-17, 0], radius_m: 4}}
uav: titan
team: team.yaml
world: world.yaml
accepts: [rtl_crosses_zones, rtl_altitude]
timers: {init_s: 5, explore_s: 5, search_s: 10}
"""
# Radios reach half as far as by default, so that not all robots receive each other here.
WORLD = """\
coordinates: local
radio: {reference_loss_db: 48.9}
robots:
  callisto: {patrol: [[-40, 30], [-45, 30]]}
  europa: {patrol: [[42, 25], [42, 30]]}
  io: {patrol: [[0, -40], [5, -40]]}
"""
# Everything that the page's title ever shows: at this speed a state may last for some frames only.
TITLES = """() => {
  globalThis.titles = [];
  const text = (id) => document.getElementById(id).textContent;
  const note = () => titles.push(
    { state: text("state"), what: text("what"), left: text("left") && parseInt(text("left")) });
  new MutationObserver(note).observe(
    document.getElementById("title"), { subtree: true, childList: true, characterData: true });
}"""
COUNTS_DOWN = """() => titles.some(({ state, left }, index) => {
  const before = titles[index - 1];
  return left && before?.state === state && left < before.left;
})"""
HAS_ROUTE = "() => document.querySelector('path.route').getAttribute('d') !== 'M0 0'"
IS_TYPICAL = """() => document.querySelector("path.link.lit")
  && document.querySelector("path.route").getAttribute("d").split("L").length > 3"""
OTHER = """() => {
  const sought = titles.findLast(({ state }) => state === "SEARCH")?.what ?? "";
  const received = [...document.querySelectorAll(".robot")].map((robot) => robot.dataset.robot);
  return sought.includes(": ") && received.find((robot) => !sought.endsWith(robot));
}"""
IS_SOUGHT = """([robot, from]) =>
  titles.slice(from).some(({ what }) => what.endsWith(": " + robot))"""
MOVES = """() => {
  const { x, y } = document.querySelector(".vehicle").getBoundingClientRect();
  globalThis.start ??= { x, y };
  return Math.hypot(x - start.x, y - start.y) > 3;
}"""
IS_CHARTED = f"""() => {{
  {PIXELS}
  const charts = [...document.querySelectorAll("#robots canvas")];
  return charts.some((chart) => pixels(chart).some((part) => part > 0));
}}"""


class Flight:
    """A simulated flight that goes on while tests look at it.

    Attributes:
        sought: The robot that was requested on the page, if any.
    """

    def __init__(self, command, mission, folder):
        self.mission = load_mission(mission)
        self.logs = folder / "logs"
        self.sought = None
        self._control = f"ipc://{folder}/control"
        self._command = command(
            "air-router",
            "sim",
            mission,
            f"--speed={SPEED}",
            "--json",
            "--web=0",
            "--control",
            f"ipc://{folder}/control",
            "--log-dir",
            self.logs,
            draws=True,
        )

    @cached_property
    def address(self):
        self._command.wait_for("the flight is shown at ")
        self._command.wait_for("/\n")
        return self._command.printed.partition("the flight is shown at ")[2].split()[0]

    @cached_property
    def landed(self):
        """Report and record: it is called home when all was seen that is asserted of it.

        If that does not happen it comes home by its battery, after 18 minutes of its time.
        """
        self._command.wait_until(
            lambda printed: has_met_all(printed) or "coming home: " in printed, "that it met all"
        )
        with ControlClient(self._control, by="the test", timeout_s=60) as uav:
            assert uav.home().accepted, self.printed
        code, out = self._command.finish()
        assert code == 0, self.printed
        (path,) = self.logs.glob("sim-*.mcap")
        report = json.loads(out)
        assert report["record"] == str(path)
        return report, list(Log(path))

    @property
    def printed(self):
        return self._command.printed


@pytest.fixture(scope="module")
def flight(shared_command, shared_folder):
    path = shared_folder / "mission.yaml"
    path.write_text(MISSION)
    (shared_folder / "world.yaml").write_text(WORLD)
    derive_team(Team.load(PENNOVATION.with_name("team.yaml")), shared_folder)
    return Flight(shared_command, PENNOVATION if PICTURED else path, shared_folder)


def has_met_all(printed):
    """Whether it has met every robot, and one of them again after another, to its end."""
    met, _, rest = printed.rpartition("COMM -> ")
    names = re.findall(r"COMM (\w+): found", met)
    again = any(name in names[index + 2 :] for index, name in enumerate(names))
    return bool(rest) and again and set(names) == ROBOTS


class Operator(Looker):
    """Looks at the flight's page, and sends requests there."""

    def __init__(self, page, address):
        super().__init__(page, address)
        page.evaluate(TITLES)
        page.locator(".vehicle").wait_for()

    def lose_and_find_the_flight(self):
        """The page shows it until it is connected again."""
        page = self.page
        shown = page.locator("#log li").count()
        faults = len(self.faults)
        page.evaluate(
            "() => { elsewhere = (where) => `${where}/nowhere`; sockets.at(-1).close(); }"
        )
        page.locator("#offline").wait_for()
        page.evaluate("() => { elsewhere = (where) => where; }")
        page.locator("#offline").wait_for(state="hidden")
        page.wait_for_function(
            "(count) => document.querySelectorAll('#log li').length >= count", arg=shown
        )
        lost = self.faults[faults:]
        assert all("WebSocket" in fault for fault in lost), lost
        del self.faults[faults:]

    def go_to(self, position):
        self.page.locator('[data-verb="goto"]').click()
        self.page.locator("#map").click(position=position)
        self.page.keyboard.press("Enter")
        self.confirm()

    def seek_another(self):
        """Once a robot is sought and another was received: stop, and request that one."""
        page = self.page
        robot = page.wait_for_function(OTHER).json_value()  # until it holds it may seek that one
        page.locator('[data-verb="hold"]').click()
        self.shows("#state", "HOLD")
        seek = page.get_by_role("button", name=f"Seek {robot} now")
        seek.click()
        page.get_by_role("button", name="Cancel").click()
        assert page.locator("#state").inner_text() == "HOLD"
        titles = page.evaluate("titles.length")
        answer = self.request(lambda: (seek.click(), self.confirm()))
        assert f"the page: accepted: it seeks {robot}" in answer
        page.wait_for_function(IS_SOUGHT, arg=[robot, titles])
        return robot


def test_the_page_shows_the_flight_and_takes_the_operator_s_requests(browser, flight):
    page = browser.new_page(viewport={"width": 1000, "height": 700})
    looker = Operator(page, flight.address)
    page.wait_for_function(MOVES)
    assert page.locator("path.area.zone").count() == len(flight.mission.zones) > 0
    page.wait_for_function(HAS_ROUTE)
    page.wait_for_function(COUNTS_DOWN)
    page.locator("path.link.lit").first.wait_for(state="attached")
    page.wait_for_function(IS_CHARTED)
    looker.lose_and_find_the_flight()
    answer = looker.request(lambda: looker.go_to({"x": 20, "y": 600}))
    assert "outside the fence" in answer
    looker.shows("#hint", "outside the fence")
    flight.sought = looker.seek_another()
    if PICTURED:
        take_pictures(page)
    assert looker.strangers(flight.address) == []
    assert looker.faults == []
    page.close()


def take_pictures(page):
    """On a laptop, in light, and on a phone, in dark."""
    for name, size in (("live", (1280, 800)), ("live-phone", (390, 844))):
        page.set_viewport_size(dict(zip(("width", "height"), size, strict=True)))
        page.locator("#fit").click()
        page.mouse.move(40, 400)
        page.locator("#hint").wait_for(state="hidden")
        page.wait_for_function(IS_TYPICAL)
        page.screenshot(path=Path(os.environ["DOCS_IMAGES"]) / f"{name}.png")
        page.locator("#theme").click()


def test_the_uav_explores_finds_all_robots_carries_their_data_and_comes_home(flight):
    report, entries = flight.landed
    assert report["outcome"] == "done"
    assert {"INIT", "SEARCH", "COMM", "EXPL", "HOME", "LAND"} <= set(report["states_visited"])
    assert report["came_home_because"]
    assert report["closest_approach_m"] >= report["clearance_m"] == 5.0

    robots, world = report["robots"], report["world"]["robots"]
    for name in ROBOTS:
        assert robots[name]["found"] >= 1
        assert robots[name]["syncs_in"] > 0
        assert robots[name]["syncs_out"] > 0
        # What the robot holds in truth, against what was painted before it last came for it.
        last_contact_s = max(
            entry.t
            for entry in entries
            if isinstance(entry.value, SyncEnded)
            and (entry.value.peer, entry.value.direction) == (name, Direction.OUT)
        )
        painted = max(
            entry.value.fields["known_cells"]
            for entry in entries
            if entry.kind == "note" and entry.value.name == "Map" and entry.t <= last_contact_s
        )
        assert world[name]["map"]["known_cells"] >= 0.8 * painted
        assert robots[name]["map_share"] >= 0.8

    carried = {tuple(pair) for pair in report["world"]["carried"]}
    assert any(
        (a, b) in carried and (b, a) in carried and world[a]["contacts"][b]["count"] == 0
        for a in world
        for b in world
    )
    assert report["interactions"]["completed"] > 0.9 * report["interactions"]["started"]

    pace = report["world"]["pace"]
    assert 0 < pace["kept"] <= pace["requested"] == SPEED
    assert {"titan", "team"} == set(pace["processes"])
    assert "times real time" in flight.printed
    assert "SEARCH -> COMM" in flight.printed
    assert "closest approach" in flight.printed
    assert (flight.logs / "track.png").read_bytes().startswith(b"\x89PNG")
    kinds = {entry.kind for entry in entries}
    assert kinds == {"about", "setup", "note", "file", "event", "action", "link", "patch"}
    assert entries[-1].value.name == "Report"
    again = replay_record(entries)
    assert again.difference is None, "\n".join(again.difference.lines())
    assert again.events > 1000


def test_what_was_requested_on_the_page_is_decided_and_recorded(flight):
    if flight.sought is None:
        pytest.skip("not requested: no browser looked on")
    _, entries = flight.landed
    values = [entry.value for entry in entries]
    at = max(index for index, value in enumerate(values) if isinstance(value, SeekNow))
    assert values[at].robot == flight.sought
    before = [value for value in values[:at] if isinstance(value, Seeking | StateChanged)]
    after = [value for value in values[at:] if isinstance(value, Seeking | StateChanged)]
    assert before[-1] != Seeking(flight.sought)
    assert State.HOLD in {value.target for value in before if isinstance(value, StateChanged)}
    assert after[0].target is State.SEARCH
    assert after[1] == Seeking(flight.sought)
    assert next(value for value in values[at:] if isinstance(value, CommandAck)).accepted
