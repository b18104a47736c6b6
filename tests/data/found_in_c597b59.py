"""Faults of commit c597b59 that no program shows in seconds, as tests in the names of that commit.

    cp tests/data/found_in_c597b59.py OLD/tests/air_router/test_found.py
    cd OLD && python -m pytest -n 0 tests/air_router/test_found.py

All fail there; the tests of the same names pass here. The whole list is
docs/evidence/faults-of-c597b59.csv.
"""

import asyncio
import contextlib
import dataclasses
import os
import re
import signal
import struct
import types

import pytest
from tests.air_router.test_flight import Rig
from tests.air_router.test_renewal import box

from air_router.actions import Answered, FlyToNode, FlyToPoint, HoldHere, RenewPlan, StateChanged
from air_router.behaviour import State
from air_router.clock import VehicleClock
from air_router.commanded import Commanded
from air_router.events import AirspaceChanged, PlanRenewed
from air_router.flight_plan import FlightPlan
from air_router.inspection import GpsFix, Inspection
from air_router.ledger import Ledger, RobotAccount
from air_router.log import read
from air_router.mapper import Mapper
from air_router.motions import MotionSender
from air_router.px4_events import Px4Event, event_id
from air_router.px4_mode import sub_mode
from air_router.px4_telemetry import Px4Telemetry
from air_router.requests import GoOn
from air_router.vehicle import FlightMode, LinkSilent, Telemetry
from air_router.whereabouts import Whereabouts
from geo.frame import Point
from geo.zone import Circle, Zone


@pytest.fixture
def cruising(pretend):
    """A flight on its way, far from home."""
    flight = pretend(duration_s=600.0)
    flight.take_off()
    flight.fly_away()
    return flight


@pytest.fixture
def px4(cruising, monkeypatch):
    """That flight as it is heard from a PX4."""
    return Px4(cruising, monkeypatch)


class Px4:
    """The streams of a PX4 that a pretended flight is heard by; some may be lost."""

    def __init__(self, flight, monkeypatch):
        self.flight = flight
        self.lost = set()
        self.plan_id = 1
        self._wall_s = 1000.0
        self.heard = {}
        clock = types.SimpleNamespace(monotonic=lambda: self._wall_s)
        monkeypatch.setattr("air_router.px4_telemetry.time", clock)
        monkeypatch.setattr("air_router.px4_telemetry.subscribe", self._subscribe)
        self.telemetry = Px4Telemetry(flight.mission.frame, VehicleClock(lambda: self._wall_s))
        self.telemetry.listen(self, 1)
        self.telemetry.guard_plan()
        self.telemetry.subscribe(flight.give)
        for name in reversed(self._messages()):
            self.says(name)

    def _subscribe(self, _direct, name, callback):
        self.heard[name] = callback

    def says(self, name, **changes):
        fields = {**self._messages()[name], **changes}
        self.heard[name](types.SimpleNamespace(fields=fields, sender=(1, 1), arrived_s=0.0))

    def run(self, seconds):
        for tick in range(round(seconds * 10)):
            self._wall_s += 0.1
            self.flight.move()
            for name in self._messages().keys() - self.lost if tick % 2 else ():
                self.says(name)
            if self.telemetry.silent_s() > 3.0:
                self.flight.give(LinkSilent(self.flight.now_s, self.telemetry.silent_s()))

    def _messages(self):
        flight = self.flight
        lat, lon = flight.mission.frame.to_geodetic(flight.position)
        east_m_s, north_m_s = flight.velocity
        place = {"time_boot_ms": flight.now_s * 1e3, "lat": lat * 1e7, "lon": lon * 1e7, "alt": 0}
        moves = {"vx": north_m_s * 100, "vy": east_m_s * 100, "hdg": 65535}
        leg = next(m for m in reversed(flight.motions) if isinstance(m, FlyToNode))
        mode = {"custom_mode": sub_mode(flight.mode) << 24 | 4 << 16}
        volts = {"voltage_battery": 16000, "onboard_control_sensors_health": 1 << 28}
        return {
            "GLOBAL_POSITION_INT": {**place, **moves, "relative_alt": flight.altitude_m * 1e3},
            "CURRENT_MODE": mode,
            "HEARTBEAT": {**mode, "base_mode": 128, "system_status": 5 if flight.failsafe else 4},
            "EXTENDED_SYS_STATE": {"landed_state": 2},
            "SYS_STATUS": {**volts, "battery_remaining": round(flight.battery * 100)},
            "GPS_RAW_INT": {"fix_type": 3, "satellites_visible": 12},
            "MISSION_CURRENT": {"seq": flight.plan.item_of(leg.node), "mission_id": self.plan_id},
        }


@pytest.mark.parametrize(
    ("stream", "words"),
    [("GLOBAL_POSITION_INT", "position"), ("SYS_STATUS", "battery"), ("GPS_RAW_INT", "GPS")],
)
def test_what_is_missing_is_told_at_its_limit_and_not_before(px4, stream, words):
    px4.lost = {stream}
    px4.run(60.0)
    assert any(words in text for text in px4.flight.said), px4.flight.said


def test_the_duration_goes_on_without_positions(pretend, monkeypatch):
    flight = pretend(duration_s=60.0)
    flight.take_off()
    px4 = Px4(flight, monkeypatch)
    px4.lost = {"GLOBAL_POSITION_INT"}
    px4.run(100.0)
    assert flight.controller.state is State.HOME


def test_the_battery_reserve_counts_without_positions(px4):
    px4.lost = {"GLOBAL_POSITION_INT"}
    px4.flight.battery = 0.1
    px4.run(10.0)
    assert px4.flight.controller.state is State.HOME


def test_a_failsafe_is_told_as_one_whichever_message_comes_first(px4):
    px4.flight.mode, px4.flight.failsafe = FlightMode.HOLD, True
    for name in ("CURRENT_MODE", "HEARTBEAT", "GLOBAL_POSITION_INT"):
        px4.says(name)
    assert any("failsafe" in text for text in px4.flight.said), px4.flight.said


def test_the_wind_that_px4_estimates_is_told(px4):
    assert "WIND_COV" in px4.heard


def test_the_same_plan_uploaded_again_is_held_for_and_flown_on(px4):
    px4.plan_id = 2
    px4.run(1.0)
    assert not any("hands off" in text for text in px4.flight.said), px4.flight.said


def test_what_resume_answers_leads_back_to_the_mission(px4):
    flight = px4.flight
    px4.plan_id = 2
    px4.run(1.0)
    flight.pilot_chooses(FlightMode.HOLD)
    flight.operator_asks(GoOn())
    answer = next(a for a in reversed(flight.actions) if isinstance(a, Answered))
    assert "start the flight anew with --resume" not in answer.why


@pytest.mark.parametrize("off_m", [25.0, -15.0], ids=["home 25 m lower", "home 15 m higher"])
def test_home_moved_up_or_down_it_holds_at_once_and_flies_on_in_the_planned_height(cruising, off_m):
    before, said = len(cruising.motions), len(cruising.said)
    cruising.altitude_m += off_m
    cruising.step()
    for _ in range(200):  # back to the planned height above the new home
        cruising.altitude_m -= off_m / 200
        cruising.step()
    assert cruising.said[said:], "it says nothing"
    assert isinstance(cruising.motions[before], HoldHere)


@pytest.mark.parametrize("state", [State.INIT, State.LAND])
def test_motors_stopped_in_the_air_are_told_as_that_until_it_is_down(pretend, state):
    flight = pretend(duration_s=60.0 if state is State.LAND else None)
    flight.take_off()
    flight.fly_to_state(state)
    flight.altitude_m, flight.armed, flight.mode = 28.0, False, FlightMode.MISSION
    flight.give(flight.telemetry())
    flight.in_air = False  # as PX4 says 0.6 s after it was disarmed
    flight.give(flight.telemetry())
    assert not any("pilot chose" in text for text in flight.said)
    assert "landed" not in flight.finished.why


def test_faster_than_commanded_is_told_and_held_for(cruising):
    said = len(cruising.said)
    for _ in range(50):
        cruising.move()
        cruising.give(dataclasses.replace(cruising.telemetry(), velocity_m_s=(12.0, 0.0)))
    assert any("m/s" in text for text in cruising.said[said:]), cruising.said[said:]


def test_it_swings_as_far_beyond_a_leg_s_end_as_its_true_speed_takes_it():
    commanded = Commanded(2.0, 3.5)
    commanded.sent(FlyToPoint(Point(100.0, 0.0), 40.0))
    (slow,), (fast,) = (
        commanded.bound(Telemetry(1.0, Point(0.0, 0.0), 40.0, velocity_m_s=(speed_m_s, 0.0)))
        for speed_m_s in (3.5, 12.0)
    )
    assert fast.reach.east_m > slow.reach.east_m + 5.0


@pytest.mark.parametrize("waits", ["jump", "reposition"])
def test_a_hold_does_not_wait_for_an_unconfirmed_jump(pennovation, waits):
    told = []

    class Deaf:
        def __getattr__(self, verb):
            async def tell(*_):
                told.append(verb)
                await asyncio.sleep(60.0 if verb == waits else 0.0)

            return tell

    async def script():
        plan = FlightPlan.of(pennovation)
        sender = MotionSender(Deaf(), plan, lambda _motion: None, lambda _report: None)
        running = asyncio.ensure_future(sender.run())
        there = Point(10.0, 0.0)
        sender.give(FlyToNode(1, there) if waits == "jump" else FlyToPoint(there, 40.0))
        await asyncio.sleep(0.05)
        sender.give(HoldHere("asked for"))
        await asyncio.sleep(0.1)
        running.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await running

    asyncio.run(script())
    assert told == [waits, "hold"]


def test_a_message_of_another_boot_or_place_is_not_believed_nor_a_burst_of_them(
    pennovation, pretend_vehicle, tmp_path
):
    flight = Rig(dataclasses.replace(pennovation, duration_s=60.0), pretend_vehicle, tmp_path)
    airframe = flight.vehicle.airframe

    def spoof():
        flight.vehicle.callback(dataclasses.replace(airframe.telemetry(), time_s=5.0))

    flight.at(lambda: airframe.now_s > 130.0, spoof)
    assert flight.run().outcome == "done"


def test_why_a_plan_is_refused_is_kept_until_something_else_is_asked():
    violation = event_id("navigator_mis_geofence_violation")
    assert "GF_MAX" in Px4Event(violation, 3, struct.pack("<h", 1)).text


def test_a_landing_whose_landed_state_comes_late_is_no_takeover(pretend):
    flight = pretend(duration_s=60.0)
    flight.take_off()
    flight.fly_to_state(State.LAND)
    flight.fly_until(lambda: flight.altitude_m < 0.1)
    flight.armed, flight.mode = False, FlightMode.MISSION  # in_air is of another stream
    flight.altitude_m = 0.0
    flight.give(flight.telemetry())
    assert not any("hands off" in text for text in flight.said)


def test_after_hands_off_breaches_are_told_again_and_again_until_they_end(cruising):
    cruising.pilot_chooses(FlightMode.OTHER)
    cruising.position = Point(5000.0, 0.0)
    cruising.fly_until(lambda: cruising.now_s > 200.0)
    assert any(text.startswith("breach of") for text in cruising.said), cruising.said


def test_a_lost_clearance_is_told_while_it_happens_and_held_for(cruising):
    cruising.position = next(
        place
        for east in range(-160, 110)
        for place in (Point(float(east), float(north)) for north in range(-160, 110, 7))
        if 3.0 < cruising.mission.airspace.distance_m(place) < 4.5
    )
    cruising.velocity = (0.0, 0.0)
    before, said = len(cruising.motions), len(cruising.said)
    cruising.step()
    assert cruising.said[said:], "it says nothing"
    assert isinstance(cruising.motions[before], HoldHere)


def test_zones_that_the_controller_refused_are_not_judged_by(pennovation):
    ledger = Ledger(pennovation, Mapper(pennovation), {"io": RobotAccount()})

    def fly(*places, start_s):
        for second, (east_m, north_m) in enumerate(places):
            now_s = start_s + second
            position = Point(east_m, north_m)
            ledger.event(Telemetry(now_s, position, 40.0, armed=True, in_air=True), now_s)

    fly((0.0, 0.0), (5.0, 0.0), start_s=10.0)
    ledger.event(AirspaceChanged(pennovation.fences, pennovation.zones), 12.0)
    ledger.action(RenewPlan())
    drawn = Zone("refused", Circle(Point(5.0, 3.0), 4.0))
    ledger.event(AirspaceChanged(pennovation.fences, (*pennovation.zones, drawn)), 12.5)
    ledger.event(PlanRenewed(), 13.0)
    fly((5.0, 0.2), (5.0, 0.4), start_s=14.0)
    assert ledger.report("done", 0.0)["closest_approach_to"] != "refused"


def test_whom_it_goes_on_to_seek_it_still_yields_unless_it_was_requested(pretend):
    flight = pretend(explore=False, name="titan", duration_s=2000.0)
    flight.take_off()
    flight.fly_to_state(State.SEARCH)
    robot = flight.controller.robot
    known = flight.controller._crew.search.roster[robot]
    tries = known.tries
    above = box(flight.position, half_m=1.0, name="above")
    flight.give(AirspaceChanged(flight.mission.fences, (*flight.mission.zones, above)))
    flight.fly_until(lambda: any(isinstance(a, RenewPlan) for a in flight.actions), 60.0)
    flight.give(PlanRenewed())
    assert (flight.controller.state, flight.controller.robot) == (State.SEARCH, robot)
    assert known.tries == tries


def test_one_bad_stamp_blinds_to_no_robot():
    robot = Whereabouts("io")
    robot.pose_heard(Point(0.0, 0.0), 9.9e10, 15.0)
    news = [robot.pose_heard(Point(k, 0.0), 1011.0 + k, 16.0 + k) for k in range(90)]
    assert sum(news) >= 86


@pytest.fixture
def resumed(pennovation, pretend_vehicle, tmp_path):
    """What the second of two companions did and said, and when the first had it in the air.

    The first was interrupted on its way to waypoint 4.
    """
    mission = dataclasses.replace(pennovation, duration_s=200.0)
    first = Rig(mission, pretend_vehicle, tmp_path)
    began_s = []

    def is_on_its_way():
        airframe = first.vehicle.airframe
        if airframe.in_air and not began_s:
            began_s.append(airframe.now_s)
        return airframe.target == mission.waypoints[3].position

    first.at(is_on_its_way, lambda: os.kill(os.getpid(), signal.SIGINT))
    first.run()
    second = Rig(mission, pretend_vehicle, tmp_path, arm=False, resume=True)
    second.vehicle.airframe = first.vehicle.airframe
    second.vehicle.inspection = Inspection(gps=GpsFix(3, 14, 0.8), battery=0.3)
    second.run()
    *entries, _ = read(second.recorder.path)
    return entries, second.out.getvalue(), began_s[0]


def test_a_resumed_flight_goes_on_where_it_was(resumed):
    entries, _, _ = resumed
    legs = [e.value for e in entries if e.kind == "action" and isinstance(e.value, FlyToNode)]
    assert 1 not in [leg.node for leg in legs[:3]]


def test_a_resumed_flight_keeps_its_duration(resumed):
    entries, _, began_s = resumed
    home_s = next(
        e.t for e in entries if isinstance(e.value, StateChanged) and e.value.target is State.HOME
    )
    assert home_s == pytest.approx(began_s + 200.0, abs=2.0)


def test_a_resumed_flight_looks_at_the_card(resumed):
    _, said, _ = resumed
    assert re.search(r"battery +30%", said)
