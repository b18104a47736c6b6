import dataclasses
import io

import pytest

from air_router.controller.model.requests import HoldNow
from air_router.controller.model.states import State
from air_router.flight.flight_line import flight_line
from air_router.flight.flight_view import situation
from air_router.flight.limits import TERMINAL_PLAIN_REFRESH_S
from air_router.flight.terminal import StatusLine
from air_router.live.scene import LiveScene
from air_router.vehicle.height_frame import HomeMove
from mocha_link.links.metrics import LinkMetrics
from mocha_link.links.reading import Reading, Unit


class Terminal(io.StringIO):
    def isatty(self):
        return True


class Clock:
    now_s = 0.0

    def __call__(self):
        return self.now_s


def test_on_a_terminal_the_line_is_drawn_over_and_permanent_lines_stay():
    out, clock = Terminal(), Clock()
    status = StatusLine(out, clock)
    status.show(lambda: "a long line")
    status.show(lambda: "not yet")
    clock.now_s = 1.0
    status.show(lambda: "short")
    status.print_line("landed")
    status.show(lambda: "again")
    status.end()
    assert "not yet" not in out.getvalue()
    assert out.getvalue().split("\r")[1:3] == ["a long line", "short      "]
    assert "landed\n" in out.getvalue()
    assert out.getvalue().endswith("again\n")


@pytest.mark.parametrize("columns", [1, 2, 5])
def test_on_a_narrow_terminal_the_line_stays_one_line(columns, monkeypatch):
    monkeypatch.setenv("COLUMNS", str(columns))
    out = Terminal()
    StatusLine(out, Clock()).show(lambda: "a long line")
    assert len(out.getvalue().strip("\r")) <= max(columns - 1, 1)


def test_without_a_terminal_a_line_now_and_then():
    out, clock = io.StringIO(), Clock()
    status = StatusLine(out, clock)
    for second in range(int(TERMINAL_PLAIN_REFRESH_S) * 2):
        clock.now_s = float(second)
        status.show(lambda s=second: f"line {s}")
    status.end()
    assert out.getvalue() == "line 0\nline 10\n"


def test_the_line_has_state_target_time_left_next_node_and_links(pretend):
    flight = pretend()
    flight.robots = {"io": flight.mission.waypoints[26].position}
    flight.take_off()
    links = {
        "io": LinkMetrics("io", signal=Reading(-61.4, Unit.DBM, "wifi")),
        "europa": LinkMetrics("europa"),
    }

    def shown(links):
        return dataclasses.replace(flight.controller.status(), links=links)

    line = flight_line(shown(links))
    for part in ("INIT", "180 s left", "-> waypoint 1", "battery 100%", "io -61 dBm"):
        assert part in line
    assert "europa" not in line
    flight.fly_to_state(State.SEARCH)
    line = flight_line(flight.controller.status())
    assert "callisto" in line
    assert "on the way" in line
    assert "dBm" not in line
    callisto = LinkMetrics("callisto", signal=Reading(31, Unit.DEVICE, "rajant"))
    line = flight_line(shown({**links, "callisto": callisto}))
    assert "| callisto 31 device |" in line  # who is sought first, the others at the end
    assert line.endswith("| io -61 dBm")


def test_the_line_and_the_page_show_the_wind_and_a_home_that_was_moved(airborne):
    flight = airborne()
    moved = HomeMove(0.0, 0.0, -25.0)
    shown = dataclasses.replace(flight.telemetry(), wind_m_s=(6.0, 0.0), home_moved=moved)
    flight.give(shown)
    line = flight_line(flight.controller.status())
    assert "40 m |" in line
    assert "wind 6 m/s from west" in line
    assert "HOME MOVED" in line
    controller = flight.controller
    scene = LiveScene(flight.mission, controller.status, lambda: controller.router, "titan")
    vehicle = scene.vehicle(controller.status())
    assert (vehicle["wind"], vehicle["home_moved"]) == ("6 m/s from west", True)


def test_the_line_and_the_status_show_what_the_mission_waits_for(airborne):
    flight = airborne()
    assert situation(flight.mission.frame, flight.controller.status(), None)["waiting"] is None
    flight.fix = False
    flight.fly_for(3.0)
    assert "| waiting: GPS has no fix (" in flight_line(flight.controller.status())
    waiting = situation(flight.mission.frame, flight.controller.status(), None)["waiting"]
    assert (waiting["interlock"], waiting["why"]) == ("INPUT_MISSING", "GPS has no fix")
    assert 2.0 <= waiting["for_s"] <= 3.0
    flight.fix = True
    flight.fly_for(5.0)
    assert "waiting" not in flight_line(flight.controller.status())
    flight.operator_requests(HoldNow())  # no motion is wanted between one loss and the next
    flight.fly_for(10.0)
    for lost in (False, True, False):
        flight.fix = lost
        flight.fly_for(6.0)
    waiting = situation(flight.mission.frame, flight.controller.status(), None)["waiting"]
    assert waiting["for_s"] <= 6.0
