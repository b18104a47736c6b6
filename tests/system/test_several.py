"""Two UAVs and two robots: one command, each UAV with a companion process of its own.

A browser looks on, where there is one. With DOCS_IMAGES=docs/images in the environment the picture
of docs/watching.md is taken anew, of missions/pair.
"""

import json
import os
import re
from pathlib import Path

import pytest

from air_router.control.control import ControlClient
from tests.system.looker import CHROMIUM, Looker

pytestmark = pytest.mark.xdist_group("flights 2")

PICTURED = "DOCS_IMAGES" in os.environ
PAIR = Path(__file__).parents[2] / "missions" / "pair" / "mission.yaml"
SPEED = 3  # the page is looked at in real time, and what is flown meanwhile costs as well
MISSION = """\
name: Two
coordinates: local
frame: {origin: [38.5, -98.5]}
home: {position: [0, 0], altitude_amsl_m: 550}
altitude_m: 22
battery_reserve: 0.1
speed_m_s: 5
waypoints: [[0, 50], [30, 50], [30, -30]]
fence: [[-60, -60], [100, -60], [100, 90], [-60, 90]]
no_fly_zones:
  - {name: hall, polygon: [[20, 10], [40, 10], [40, 30], [20, 30]]}
uavs:
  titan:
  atlas: {altitude_m: 10, explore: false, home: [-22, 0]}
team: team.yaml
world: world.yaml
timers: {init_s: 2, explore_s: 10, search_s: 10, communicate_s: 10}
"""
ROBOTS = ("atlas", "europa", "io", "titan")
KINDS = """\
kinds:
  ground_robot:
    topics: [{name: /pose, type: json/Pose, min_interval_s: 1}]
  aerial_robot:
    topics:
      - {name: /map, type: grid/SemanticMap, min_interval_s: 5}
      - {name: /seek, type: json/Seek, priority: high}
"""
# Out of radio reach of home: a robot that is always in reach is never due for a visit.
WORLD = """\
coordinates: local
robots:
  europa: {patrol: [[-20, 62], [0, 62]]}
  io: {patrol: [[52, -36], [52, -46]]}
"""
BOTH_MOVE = """() => {
  globalThis.starts ??= {};
  const vehicles = [...document.querySelectorAll(".vehicle")];
  return vehicles.length === 2 && vehicles.map((vehicle) => {
    const { x, y } = vehicle.getBoundingClientRect();
    const start = starts[vehicle.textContent] ??= { x, y };
    return Math.hypot(x - start.x, y - start.y) > 3;
  }).every(Boolean);
}"""
ROBOTS_SHOWN = "[...document.querySelectorAll('.robot')].map((robot) => robot.dataset.robot)"
NO_ROBOT_TWICE = (
    f"() => {ROBOTS_SHOWN}.sort().join() === [...new Set({ROBOTS_SHOWN})].sort().join()"
)
AGES_CHANGE = """() => {
  const ages = document.querySelector(".leaflet-marker-pane").innerText;
  return ages !== (globalThis.ages ??= ages);
}"""

NONSENSE = """() => {
  const socket = sockets.findLast(({ url }) => url.includes("titan"));
  socket.onmessage({ data: '{"type": "track", "from": 0, "points": [[1, "x"]]}' });
}"""


def team():
    lines = ["robots:"]
    for number, name in enumerate(ROBOTS, 1):
        kind = "aerial_robot" if name in {"atlas", "titan"} else "ground_robot"
        peers = ", ".join(other for other in ROBOTS if other != name)
        lines.append(
            f"  {name}: {{kind: {kind}, address: 127.0.1.{number}, listen: 127.0.0.{number}, "
            f"base_port: {26000 + 10 * number}, clients: [{peers}], "
            f"radio: 'udp://127.0.0.{number}:{26005 + 10 * number}'}}"
        )
    return "\n".join(lines) + "\n" + KINDS


@pytest.fixture(scope="module")
def flight(shared_command, shared_folder):
    """It goes on until both are requested to come home, on the page or by the test."""
    for name, text in (("mission", MISSION), ("team", team()), ("world", WORLD)):
        (shared_folder / f"{name}.yaml").write_text(text)
    mission, control = shared_folder / "mission.yaml", f"ipc://{shared_folder}/control"
    options = [f"--speed={SPEED}", "--json", "--web=0", "--control", control]
    flight = shared_command("air-router", "sim", PAIR if PICTURED else mission, *options)
    flight.controls = (control, f"{control}-2")
    return flight


class Operator(Looker):
    """Looks at the page of both, and sends requests to one or the other."""

    def choose(self, name, press):
        press()
        self.page.locator("#tabs button[aria-selected=true]", has_text=name).wait_for()
        assert self.page.locator("#facts").inner_text().startswith(f"{name} · ")

    def tab(self, name):
        return self.page.locator("#tabs button", has_text=name)

    def state(self, name):
        return self.tab(name).locator(".chip").inner_text()

    def robots(self):
        return self.page.evaluate(ROBOTS_SHOWN)

    def holds(self):
        self.page.locator('[data-verb="hold"]').click()

    def home(self):
        self.page.locator('[data-verb="home"]').click()
        self.confirm()


def test_one_page_shows_both_and_sends_requests_to_the_one_that_is_chosen(browser, flight):
    flight.wait_for("the flights are shown at ")
    flight.wait_for("/\n")
    address = flight.printed.partition("the flights are shown at ")[2].split()[0]
    page = browser.new_page(viewport={"width": 1000, "height": 700})
    looker = Operator(page, address)
    page.wait_for_function(BOTH_MOVE)
    looker.shows("#log li:has(b.uav1)", "→ SEARCH")
    looker.shows("#log li", ": found")
    looker.shows("#facts", "titan · ")
    corridor = page.locator("path.area.zone[data-name='home of titan']")
    assert corridor.count() == 0
    looker.choose("atlas", lambda: page.keyboard.press("2"))
    corridor.wait_for(state="attached")
    if PICTURED:
        take_pictures(looker)
        return

    answer = looker.request(looker.holds)
    assert "atlas the page: accepted" in answer
    looker.shows("#state", "HOLD")
    assert looker.state("atlas") == "HOLD"
    assert looker.state("titan") != "HOLD"
    assert page.locator("#log li.answer:has(b.uav1)").count() == 0

    page.evaluate("() => { elsewhere = (where) => where.replace('atlas', 'phantom'); }")
    page.evaluate("sockets.findLast(({ url }) => url.includes('atlas')).close()")
    looker.shows("#offline", "atlas does not answer")
    looker.shows("#tabs button.uav2 .chip", "offline")
    page.wait_for_function(AGES_CHANGE)
    page.evaluate("() => { elsewhere = (where) => where; }")
    page.locator("#offline").wait_for(state="hidden")
    looker.shows("#state", "HOLD")
    robots = looker.robots()
    assert set(robots) <= {"europa", "io"}
    assert len(set(robots)) == len(robots) > 0

    page.evaluate(NONSENSE)
    # The message stays in the page; it is visible only until the next try succeeds.
    page.locator("#offline", has_text="titan sent an invalid message").wait_for(state="attached")
    page.locator("#offline").wait_for(state="hidden")
    assert "not a position" in looker.faults.pop()

    page.set_viewport_size({"width": 390, "height": 844})
    looker.choose("titan", looker.tab("titan").click)
    looker.choose("atlas", lambda: page.locator(".vehicle.uav2").dispatch_event("click"))
    looker.request(page.locator("#hold-all").click, answers=2)
    looker.shows("#tabs button.uav1 .chip", "HOLD")
    for name in ("atlas", "titan"):
        looker.choose(name, looker.tab(name).click)
        assert f"{name} the page: accepted" in looker.request(looker.home)
    assert looker.strangers(address) == []
    assert looker.faults == []
    page.close()


def take_pictures(looker):
    page = looker.page
    page.set_viewport_size({"width": 1280, "height": 800})
    page.locator("#fit").click()
    page.mouse.move(40, 400)
    looker.shows("#log li:has(b.uav2)", ": found")
    looker.shows("#log li:has(b.uav1)", ": found")
    page.screenshot(path=Path(os.environ["DOCS_IMAGES"]) / "live-several.png")


@pytest.mark.skipif(PICTURED, reason="another mission is flown for the picture")
def test_one_explores_one_searches_and_they_keep_apart(flight):
    if CHROMIUM is None:
        flight.wait_for(": found")
        for control in flight.controls:
            with ControlClient(control, by="the test", timeout_s=60) as uav:
                assert uav.home().accepted
    code, out = flight.finish()
    assert code == 0, re.sub(r".* s {2}.*\n", "", flight.printed)  # without what either decided
    report = json.loads(out)
    titan, atlas = report["uavs"]["titan"], report["uavs"]["atlas"]
    assert titan["outcome"] == atlas["outcome"] == "done"
    assert {"INIT", "SEARCH"} <= set(titan["states_visited"])
    assert not {"INIT", "EXPL"} & set(atlas["states_visited"])
    assert "SEARCH" in atlas["states_visited"]
    assert sum(robot["found"] for uav in (titan, atlas) for robot in uav["robots"].values()) >= 1
    for uav in (titan, atlas):
        assert uav["closest_approach_m"] >= uav["clearance_m"] == 5.0
        assert set(uav["robots"]) == {"europa", "io"}, "the other UAV is not sought"
    (pair,) = report["world"]["vehicles"]
    assert pair["pair"] == ["titan", "atlas"]
    assert pair["contacts"] >= 1
    # Twelve metres between the layers, and each vehicle is off its own by a metre or so.
    assert pair["closest_m"] >= 9.0
    assert pair["level_m"] is None or pair["level_m"] >= 9.0
    held = report["world"]["robots"]["io"]["holds"]
    assert {"titan", "atlas"} <= {
        message["robot"] for message in held if message["topic"] == "/seek"
    }
    first, *lines = flight.printed.splitlines()
    assert first.startswith("the flights are shown at ")
    assert "the flight is shown at" not in flight.printed
    assert all(line.startswith(("titan  ", "atlas  ")) for line in lines[: len(lines) // 2])
    assert "titan and atlas: never nearer than" in flight.printed
