import asyncio
import base64
import dataclasses
import json
import os
import signal
import zlib
from datetime import UTC, datetime

import pytest

from air_router.control.command_request import View, parse_command
from air_router.controller.model.actions import FlyToNode, StateChanged
from air_router.controller.model.events import AirspaceChanged, CommandConfirmed
from air_router.controller.model.flight_setup import FlightSetup
from air_router.controller.model.requests import HoldNow
from air_router.errors import (
    ArmingRefusedError,
    ExitCode,
    NotConfirmedError,
    NoVehicleError,
    PlanRefusedError,
    RefusedError,
)
from air_router.mission.mission import FlightWindow
from air_router.preflight.card import PreflightRefusedError
from air_router.record.log import Log
from air_router.record.replay import replay_record
from air_router.report.flight_table import table
from air_router.vehicle.airframe import Airframe
from air_router.vehicle.instructions import IN_YOUR_HANDS, Severity
from air_router.vehicle.vehicle import (
    Ages,
    FlightMode,
    Inspection,
    LinkSilent,
    MavlinkSpoofed,
    PlanCompared,
    PlanReplaced,
    PlanTried,
    Telemetry,
    WrongVehicle,
)
from geo.airspace.zone import Circle, Zone
from geo.frame import Point
from geo.grid import SemanticGrid
from geo.validity import Validity
from tests.air_router.conftest import STEP_S
from tests.air_router.flight.whole_flight import WholeFlight

PILOT = "waiting for the pilot"


class Rig(WholeFlight):
    def plan(self, *steps):
        """What happens, one thing after the other: when, and what is done then.

        When: the vehicle's clock in seconds, text that was printed, or a condition.
        """
        left = list(steps)

        def come(when):
            if isinstance(when, str):
                return when in self.out.getvalue()
            return when() if callable(when) else self.vehicle.airframe.now_s > when

        def on_step():
            if left and come(left[0][0]):
                left.pop(0)[1]()

        self.vehicle.on_step = on_step

    def in_charge(self):
        return self.flight.controller.context.in_charge

    def becomes(self, mode, **state):
        """The pilot, or PX4, chooses a mode; nothing is flown to any more."""
        state = {"mode": mode, "target": None, **state}
        return lambda: [setattr(self.vehicle.airframe, *each) for each in state.items()]


def sends(number):
    """The signal comes."""
    return lambda: os.kill(os.getpid(), number)


@pytest.fixture
def rig(pennovation, pretend_vehicle, tmp_path):
    def make(*, arm=True, resume=False, **changes):
        mission = dataclasses.replace(pennovation, **{"duration_s": 60.0, **changes})
        return Rig(mission, pretend_vehicle, tmp_path, arm=arm and not resume, resume=resume)

    return make


def test_a_flight_from_connecting_to_landing(rig):
    flight = rig()
    result = flight.run()
    assert (result.outcome, result.exit_code) == ("done", ExitCode.DONE)
    assert flight.vehicle.verbs[:5] == ["connect", "inspect", "upload", "arm", "start"]
    assert flight.vehicle.verbs[-2:] == ["land", "close"]
    assert flight.gossip.closed
    report = result.report
    assert report["states_visited"] == ["INIT", "HOME", "LAND", "DONE"]
    assert report["duration_s"] > 60
    assert report["distance_m"] > 100
    assert report["closest_approach_m"] >= report["clearance_m"] == 5.0
    assert report["robots"]["callisto"]["found"] == 0
    assert json.loads(json.dumps(report)) == report
    assert "done: " in table(report)
    assert any("coming home" in text for text, _ in flight.vehicle.announced)
    view = flight.flight.commands.execute(View(request="view", areas=True, map=True), "a test")
    steps = [(change["number"], change["left"], change["signal"]) for change in view["changes"]]
    assert steps[:2] == [(1, "READY", "AIRBORNE"), (2, "INIT", "COME_HOME")]
    assert (view["uav"], view["state"], view["known_cells"]) == ("titan", "DONE", 0)
    assert (
        view["areas"]["name"] == flight.flight.controller.context.airspace.router.graph.mission.name
    )
    assert SemanticGrid.decode(zlib.decompress(base64.b64decode(view["map"]))).known_cells == 0


def test_everything_is_recorded_and_replays_and_the_report_is_the_last_line(rig):
    flight = rig()
    result = flight.run()
    *entries, last = Log(flight.recorder.path)
    kinds = {type(entry.value) for entry in entries}
    assert {Telemetry, CommandConfirmed, StateChanged, FlyToNode, FlightSetup} <= kinds
    assert last.value.name == "Report"
    assert last.value.fields["outcome"] == result.outcome
    again = replay_record(entries)
    assert again.difference is None
    assert again.actions == sum(entry.kind == "action" for entry in entries) > 10


def test_no_take_off_after_the_hour_that_the_zones_were_chosen_for(rig, pennovation):
    latest = datetime.fromtimestamp(1.7e9 + 20, UTC)
    window = FlightWindow(latest, latest, latest)
    timed = Zone("timed", pennovation.zones[0].shape, validity=Validity(()))
    flight = rig(arm=False, window=window, zones=(timed,))
    result = flight.run()
    assert result.exit_code == ExitCode.REFUSED
    assert result.outcome.startswith("refused: it had not taken off by 22:13 UTC")
    assert "arm" not in flight.vehicle.verbs
    flight = rig(arm=False, window=window)
    zones = AirspaceChanged(pennovation.fences, (timed,))  # reloaded before the take-off
    flight.plan((lambda: flight.flight._admitted, lambda: flight.flight.loop.on_event(zones)))
    assert flight.run().exit_code == ExitCode.REFUSED
    flight = rig(arm=False, window=window)  # all zones count at all times
    flight.plan((lambda: flight.clock.now_s() > 1.7e9 + 40, flight.vehicle.airframe.take_off))
    assert flight.run().outcome == "done"


def hands_over(flight):
    """The pilot takes off and flies by hand, and chooses Mission mode later."""
    airframe = flight.vehicle.airframe
    airframe.take_off()
    airframe.mode = FlightMode.POSITION


@pytest.mark.parametrize("reloaded", [True, False], ids=["reloaded", "flown by hand meanwhile"])
def test_when_the_hours_of_its_zones_are_over_it_comes_home(rig, pennovation, reloaded):
    latest = datetime.fromtimestamp(1.7e9 + 20, UTC)
    timed = Zone("timed", Circle(Point(300.0, 300.0), 5.0), validity=Validity(()))
    zones = {} if reloaded else {"zones": (timed,)}
    window = FlightWindow(latest, None, latest)
    flight = rig(window=window, duration_s=300.0, arm=False, **zones)
    drawn = AirspaceChanged(pennovation.fences, (*pennovation.zones, timed))

    def after(passed_s):
        return lambda: flight.clock.now_s() - 1.7e9 > passed_s

    if reloaded:
        flight.plan(
            (after(30.0), flight.vehicle.airframe.take_off),
            (after(200.0), lambda: flight.flight.loop.on_event(drawn)),
        )
    else:
        flight.plan(
            (after(10.0), lambda: hands_over(flight)),
            (after(90.0), flight.vehicle.airframe.take_off),
        )
    result = flight.run()
    why = "the active hours of its selected no-fly zones are over"
    assert (result.outcome, result.report["came_home_because"]) == ("done", why)
    assert replay_record([*Log(flight.recorder.path)]).difference is None


def test_a_vehicle_that_answers_and_sends_no_position_is_none(rig, monkeypatch):
    async def mute():
        pass

    flight = rig()
    flight.vehicle.stream = mute
    monkeypatch.setattr("air_router.flight.flight.VEHICLE_LOST_S", 0.05)
    with pytest.raises(NoVehicleError, match="sent no position"):
        flight.run()


def test_without_arm_the_pilot_starts_it(rig):
    flight = rig(arm=False)
    flight.plan((PILOT, flight.vehicle.airframe.take_off))
    assert flight.run().outcome == "done"
    assert "arm" not in flight.vehicle.verbs
    assert "start" not in flight.vehicle.verbs


def test_nothing_that_waited_is_sent_once_the_pilot_has_it(rig):
    flight = rig(duration_s=None)
    vehicle, answer = flight.vehicle, asyncio.Event()
    answered = []

    async def jump(item, objection, *, out_of):
        vehicle.verbs.append("jump")
        await answer.wait()
        answered.append(item)

    vehicle.jump = jump
    flight.plan(
        (149.9, sends(signal.SIGUSR1)),  # home: a motion that waits for its turn
        (160.0, flight.becomes(FlightMode.OTHER)),
        (200.0, answer.set),
        (250.0, flight.becomes(FlightMode.LAND)),
    )
    result = flight.run()
    assert result.exit_code == ExitCode.PILOT_TOOK_OVER
    assert "HOME" in result.report["states_visited"]
    assert answered == []
    assert vehicle.verbs.count("jump") == 1
    assert not {"reposition", "hold", "land"} & set(vehicle.verbs)


def test_a_failsafe_is_distinguished_from_a_pilot(rig):
    flight = rig(duration_s=None)
    flight.plan((150.0, flight.becomes(FlightMode.LAND, failsafe=True)))
    result = flight.run()
    assert (result.outcome, result.exit_code) == ("failsafe", ExitCode.ENDED_OTHERWISE)


def test_ctrl_c_holds_the_vehicle(rig):
    flight = rig(duration_s=None)
    flight.plan((150.0, sends(signal.SIGINT)))
    result = flight.run()
    assert (result.outcome, result.exit_code) == ("interrupted", ExitCode.INTERRUPTED)
    assert flight.vehicle.verbs[-2:] == ["hold", "close"]
    assert flight.vehicle.airframe.mode is FlightMode.HOLD
    assert flight.gossip.closed


def test_everything_is_closed_whatever_holding_ends_in(rig):
    flight = rig(arm=True)
    flight.vehicle.failures["hold"] = [OSError("the link broke")]
    flight.plan(("READY -> INIT", sends(signal.SIGINT)))
    with pytest.raises(OSError, match="the link broke"):
        flight.run()
    assert flight.vehicle.verbs[-2:] == ["hold", "close"]
    assert flight.gossip.closed


def test_ctrl_c_leaves_a_pilot_s_vehicle_alone(rig):
    flight = rig(duration_s=None)
    flight.plan((149.9, flight.becomes(FlightMode.OTHER)), (159.9, sends(signal.SIGINT)))
    assert flight.run().exit_code == ExitCode.INTERRUPTED
    assert "hold" not in flight.vehicle.verbs
    assert flight.vehicle.airframe.mode is FlightMode.OTHER


def test_ctrl_c_on_the_ground_commands_nothing(rig):
    flight = rig(arm=False)
    flight.plan((PILOT, sends(signal.SIGINT)))
    assert flight.run().exit_code == ExitCode.INTERRUPTED
    assert flight.vehicle.verbs == ["connect", "inspect", "upload", "close"]


@pytest.mark.parametrize(
    ("verb", "error"),
    [
        ("connect", NoVehicleError("no answer there")),
        ("upload", PlanRefusedError("not taken")),
        ("arm", ArmingRefusedError("no GPS")),
        ("start", NotConfirmedError("stays in Hold mode")),
    ],
)
def test_what_fails_before_take_off_ends_the_flight_with_its_reason(rig, verb, error):
    flight = rig()
    flight.vehicle.failures[verb] = [error]
    with pytest.raises(type(error), match=str(error)):
        flight.run()
    assert flight.vehicle.verbs[-1] == "close"
    assert flight.gossip.closed


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"armed": True}, "is armed"),
        ({"position": Point(40.0, 0.0)}, "40 m from the mission's home"),
    ],
)
def test_a_vehicle_that_is_not_ready_is_refused_before_anything_is_uploaded(rig, change, message):
    flight = rig()
    for name, value in change.items():
        setattr(flight.vehicle.airframe, name, value)
    with pytest.raises(RefusedError, match=message):
        flight.run()
    assert "upload" not in flight.vehicle.verbs
    assert flight.vehicle.verbs[-1] == "close"


def test_a_red_line_of_the_pre_flight_card_refuses_before_anything_is_uploaded(rig):
    flight = rig()
    flight.vehicle.inspection = Inspection(healthy=False, problems=("no GPS fix; wait",))
    with pytest.raises(PreflightRefusedError, match="not ready to arm; no GPS fix; wait") as caught:
        flight.run()
    assert caught.value.exit_code == ExitCode.REFUSED
    assert flight.vehicle.verbs == ["connect", "inspect", "close"]
    notes = [e.value.name for e in Log(flight.recorder.path) if e.kind == "note"]
    assert "Preflight" in notes


def test_nothing_is_decided_on_a_vehicle_that_is_refused(rig):
    flight = rig()
    flight.vehicle.airframe.take_off()  # a pilot's flight, just above home
    with pytest.raises(RefusedError, match="is flying"):
        flight.run()
    assert "READY -> INIT" not in flight.out.getvalue()
    assert flight.vehicle.announced == []


def in_flight(flight, mode=FlightMode.HOLD):
    """The vehicle hovers at its first waypoint, as a companion that died has left it."""
    airframe, mission = flight.vehicle.airframe, flight.vehicle.airframe.mission
    airframe.take_off()
    airframe.mode, airframe.position = mode, mission.waypoints[0].position


def test_a_flight_that_is_under_way_is_found_and_left_alone(rig):
    flight = rig()
    in_flight(flight)
    with pytest.raises(
        RefusedError, match=r"with this mission on board; land it, or give --resume"
    ):
        flight.run()
    assert flight.vehicle.verbs == ["connect", "recognise", "close"]


@pytest.mark.parametrize("resume", [False, True])
def test_another_type_of_vehicle_in_the_air_is_refused_and_not_queried(rig, resume):
    flight = rig(resume=resume)
    in_flight(flight)
    flight.vehicle.kind = Airframe(22)
    with pytest.raises(
        RefusedError, match=r"VTOL .MAV_TYPE 22.*nothing is sent to it: connect a multi"
    ):
        flight.run()
    assert flight.vehicle.verbs == ["connect", "close"]


def test_another_type_of_vehicle_on_the_ground_is_refused_with_the_card(rig):
    flight = rig()
    flight.vehicle.kind = Airframe(1)
    with pytest.raises(PreflightRefusedError, match=r"fixed wing .MAV_TYPE 1"):
        flight.run()
    assert flight.vehicle.verbs == ["connect", "close"]


def test_a_type_that_changes_while_it_is_made_ready_ends_that(rig):
    flight = rig()
    vehicle = flight.vehicle
    why = Airframe(1).why_not_flown
    reported = []

    def other_type():
        if not reported and "upload" not in vehicle.verbs:
            reported.append(vehicle.callback(WrongVehicle(vehicle.airframe.now_s, why)))

    vehicle.on_step = other_type
    result = flight.run()
    assert (result.exit_code, why in result.outcome) == (ExitCode.REFUSED, True)
    assert not {"arm", "start"} & set(vehicle.verbs)


@pytest.mark.parametrize("in_air", [False, True])
def test_what_is_received_once_during_the_pre_flight_is_announced(rig, in_air):
    flight = rig(resume=in_air)
    if in_air:
        in_flight(flight)
    name = "recognise" if in_air else "inspect"
    verb = getattr(flight.vehicle, name)

    async def meanwhile(argument):
        flight.vehicle.callback(MavlinkSpoofed(flight.vehicle.airframe.now_s, 3))
        return await verb(argument)

    setattr(flight.vehicle, name, meanwhile)
    assert flight.run().outcome == "done"
    assert flight.out.getvalue().count("3 MAVLink messages posed as the vehicle") == 1


def test_another_mission_s_flight_is_not_resumed(rig):
    flight = rig(resume=True)
    in_flight(flight)
    flight.vehicle.failures["recognise"] = [PlanRefusedError("3 items sent, 4 are on board")]
    with pytest.raises(RefusedError, match="not with this mission on board"):
        flight.run()
    assert flight.vehicle.verbs == ["connect", "recognise", "close"]


@pytest.mark.parametrize("mode", [FlightMode.HOLD, FlightMode.MISSION])
def test_a_flight_that_lost_its_companion_goes_on_when_requested(rig, mode):
    flight = rig(resume=True)
    in_flight(flight, mode)
    result = flight.run()
    assert result.outcome == "done"
    assert not {"upload", "arm", "start"} & set(flight.vehicle.verbs)
    assert "with this mission on board" in flight.out.getvalue()


def test_a_flight_that_the_pilot_flies_is_not_resumed(rig):
    flight = rig(resume=True)
    in_flight(flight, FlightMode.OTHER)
    with pytest.raises(RefusedError, match="nothing is sent to the vehicle"):
        flight.run()
    assert "choose Hold first" in flight.out.getvalue()
    assert flight.vehicle.verbs == ["connect", "recognise", "inspect", "close"]


def test_on_the_ground_there_is_nothing_to_resume(rig):
    flight = rig(resume=True)
    with pytest.raises(RefusedError, match="nothing to resume"):
        flight.run()


def test_a_pilot_who_takes_over_lands_it_and_that_is_announced_in_the_ground_station(rig):
    flight = rig(duration_s=None)
    flight.plan((150.0, flight.becomes(FlightMode.LAND)))
    result = flight.run()
    assert (result.outcome, result.exit_code) == ("pilot", ExitCode.PILOT_TOOK_OVER)
    assert not {"hold", "land"} & set(flight.vehicle.verbs)
    text = f"air_router: hands off: the pilot chose Land mode. {IN_YOUR_HANDS}"
    assert (text, Severity.WARNING) in flight.vehicle.announced
    assert "hands off" in flight.out.getvalue()


def test_the_operator_has_the_mission_resumed_by_a_signal(rig):
    flight = rig(duration_s=90.0)
    flight.plan(
        (149.9, flight.becomes(FlightMode.OTHER)),
        (154.9, flight.becomes(FlightMode.HOLD)),
        (159.9, sends(signal.SIGUSR2)),
    )
    result = flight.run()
    assert result.outcome == "done"
    assert {"PASSIVE", "EXPL"} <= set(result.report["states_visited"])


def test_lines_that_come_again_and_again_are_counted_but_for_warnings(rig):
    flight = rig(duration_s=None)
    why = "no multicopter with PX4 is on the link (a plane)"

    def requests(text):
        return lambda: flight.flight.commands.execute(parse_command(text), "a test")

    def receives(event):
        return lambda: flight.vehicle.callback(event)

    tried = [(130.0 + t, receives(PlanTried(130.0 + t, "a station"))) for t in range(3)]
    same = [(150.0 + t, receives(PlanCompared(150.0 + t))) for t in range(8)]
    tried += [*same[:6], (155.5, requests("explore")), *same[6:]]
    others = [(180.0 + t, receives(WrongVehicle(180.0 + t, (why, None)[t % 2]))) for t in range(6)]
    flight.plan(*tried, *others, (200.0, flight.becomes(FlightMode.LAND)))
    flight.run()
    lines = [line[11:].strip() for line in flight.out.getvalue().splitlines()]
    assert len([line for line in lines if line.startswith("WARNING: a station tries")]) == 3
    reported = [line.partition("the plan on board")[0] for line in lines if "is equivalent" in line]
    # After the reply the line is printed in full once more.
    assert reported == ["", "again 5 times: ", "", "again: "]
    answer = next(number for number, line in enumerate(lines) if line.startswith("a test: "))
    assert lines[answer - 1].startswith("again 5 times: the plan on board is")
    assert len([line for line in lines if line.startswith(f"ALARM: {why}")]) == 3


def test_ctrl_c_twice_leaves_at_once(rig, monkeypatch):
    flight = rig(duration_s=None)
    left = []

    class Left(BaseException):
        pass

    def leave(code):
        left.append((code, list(flight.vehicle.verbs)))
        raise Left

    monkeypatch.setattr(os, "_exit", leave)
    hold = flight.vehicle.hold

    async def hold_and_be_interrupted_again(*, out_of):
        flight.flight._on_interrupt()
        await hold(out_of=out_of)

    flight.vehicle.hold = hold_and_be_interrupted_again
    flight.plan((150.0, sends(signal.SIGINT)))
    with pytest.raises(Left):
        flight.run()
    ((code, verbs),) = left
    assert code == ExitCode.INTERRUPTED
    assert "hold" not in verbs


def test_telemetry_while_the_link_is_closed_is_ignored(rig):
    flight = rig()
    vehicle = flight.vehicle
    sent = []
    close = vehicle.close

    async def talk_and_close():
        vehicle.callback(vehicle.airframe.telemetry())  # Alone.publish_telemetry() would object
        sent.append(True)
        await close()

    vehicle.close = talk_and_close
    assert flight.run().outcome == "done"
    assert sent


def test_ctrl_c_in_a_climb_that_the_pilot_started_holds_the_vehicle(rig):
    flight = rig(arm=False)
    airframe = flight.vehicle.airframe

    def start():
        airframe.take_off()
        airframe.altitude_m /= 2

    flight.plan((PILOT, start), (flight.in_charge, sends(signal.SIGINT)))
    assert flight.run().exit_code == ExitCode.INTERRUPTED
    assert flight.vehicle.verbs[-2:] == ["hold", "close"]


@pytest.mark.parametrize(
    ("silent_s", "over", "code"),
    [(59.0, False, 0), (61.0, False, ExitCode.ENDED_OTHERWISE), (90.0, True, 0)],
)
def test_a_vehicle_that_is_silent_for_a_minute_is_lost(rig, silent_s, over, code):
    flight = rig(duration_s=200.0)
    silent = LinkSilent(150.0, silent_s, over)
    flight.plan((150.0, lambda: flight.vehicle.callback(silent)))
    result = flight.run()
    assert result.exit_code == code
    assert ("silent" in result.outcome) == bool(code)


@pytest.mark.parametrize("arm", [False, True], ids=["on the ground", "in the air"])
def test_a_vehicle_that_restarts_is_not_commanded(rig, arm):
    flight = rig(arm=arm, duration_s=None)
    flight.plan((150.0 if arm else PILOT, lambda: setattr(flight.vehicle.airframe, "now_s", 3.0)))
    result = flight.run()
    assert result.exit_code == ExitCode.ENDED_OTHERWISE
    assert "restarted" in result.outcome
    assert "hold" not in flight.vehicle.verbs


def test_what_the_pilot_armed_meanwhile_is_not_started(rig):
    flight = rig()
    vehicle = flight.vehicle
    arm = vehicle.arm

    async def arm_and_see_it_fly():
        await arm()
        vehicle.airframe.take_off()
        vehicle.airframe.mode = FlightMode.OTHER
        seen = flight.flight.controller.context
        while not (seen.telemetry and seen.telemetry.in_air):  # noqa: ASYNC110
            await asyncio.sleep(0)

    vehicle.arm = arm_and_see_it_fly
    with pytest.raises(RefusedError, match="left to the pilot"):
        flight.run()
    assert "start" not in vehicle.verbs
    assert "hold" not in vehicle.verbs


def test_a_fault_in_a_decision_ends_the_flight_and_holds_the_vehicle(rig):
    flight = rig(duration_s=None)

    def fault(*_):
        raise ZeroDivisionError("of ours")

    def break_it():
        loop = asyncio.get_running_loop()
        flight.flight.controller.handle = fault
        loop.call_soon(flight.vehicle.callback, flight.vehicle.airframe.telemetry())

    flight.plan((150.0, break_it))
    with pytest.raises(ZeroDivisionError):
        flight.run()
    assert flight.vehicle.verbs[-2:] == ["hold", "close"]


@pytest.mark.parametrize(("chosen", "holds"), [(None, True), (FlightMode.POSITION, False)])
def test_ctrl_c_while_take_off_is_commanded_holds_it_unless_the_pilot_has_it(rig, chosen, holds):
    flight = rig()
    airframe = flight.vehicle.airframe

    async def start():  # the mode has left, and does not show yet
        airframe.mode = chosen or airframe.mode
        os.kill(os.getpid(), signal.SIGINT)
        await asyncio.sleep(60.0)

    flight.vehicle.start = start
    flight.run()
    assert ("hold" in flight.vehicle.verbs) is holds


@pytest.mark.parametrize("lost", ["all", "mode"])
def test_a_vehicle_that_may_have_been_taken_in_silence_is_left_as_it_is(rig, lost):
    flight = rig(duration_s=None)
    airframe = flight.vehicle.airframe
    telemetry = airframe.telemetry

    def lose_all():
        flight.vehicle.running.cancel()
        asyncio.get_running_loop().call_soon(then)

    def then():
        airframe.mode = FlightMode.POSITION
        flight.vehicle.callback(LinkSilent(airframe.now_s, 4.0))
        sends(signal.SIGINT)()

    def lose_the_mode():
        began_s, airframe.mode = airframe.now_s, FlightMode.POSITION
        airframe.telemetry = lambda: dataclasses.replace(
            telemetry(), mode=FlightMode.MISSION, ages=Ages(mode_s=airframe.now_s - began_s)
        )
        flight.plan((began_s + 6.0, sends(signal.SIGINT)))

    flight.plan((130.0, lose_all if lost == "all" else lose_the_mode))
    flight.run()
    assert "hold" not in flight.vehicle.verbs
    assert "the flight mode was not received. Pilot: take over" in flight.out.getvalue()


def test_a_plan_that_a_ground_station_puts_on_board_meanwhile_is_not_started(rig):
    flight = rig()
    arm = flight.vehicle.arm

    async def replaced_meanwhile():
        await arm()
        flight.vehicle.callback(PlanReplaced(flight.vehicle.airframe.now_s))

    flight.vehicle.arm = replaced_meanwhile
    with pytest.raises(RefusedError, match="uploaded another plan or fence"):
        flight.run()
    assert "start" not in flight.vehicle.verbs


def test_called_off_before_the_climb_it_does_not_climb_alone(rig):
    flight = rig()
    airframe = flight.vehicle.airframe

    async def start():
        airframe.mode = FlightMode.MISSION  # armed, and about to climb
        flight.plan((flight.in_charge, sends(signal.SIGUSR1)))

    flight.vehicle.start = start
    assert flight.run().exit_code == ExitCode.ENDED_OTHERWISE
    assert flight.vehicle.verbs[-2:] == ["hold", "close"]


@pytest.mark.parametrize("chosen", [FlightMode.OTHER, FlightMode.RETURN])
def test_a_mode_that_the_pilot_chose_while_we_got_ready_is_not_taken_back(rig, chosen):
    flight = rig()
    vehicle = flight.vehicle
    upload = vehicle.upload

    async def upload_while_the_pilot_chooses(plan):
        await upload(plan)
        vehicle.airframe.mode = chosen
        seen = flight.flight.controller.context
        while not (seen.telemetry and seen.telemetry.mode is chosen):  # noqa: ASYNC110
            await asyncio.sleep(0)

    vehicle.upload = upload_while_the_pilot_chooses
    with pytest.raises(RefusedError, match=f"the pilot chose {chosen.value} mode"):
        flight.run()
    assert not {"arm", "start", "hold"} & set(vehicle.verbs)


def unconfirmed_jumps(flight):
    """From now on jumps leave, and neither show nor fail."""

    async def jump(item, objection, *, out_of):
        flight.vehicle.verbs.append("jump")
        await asyncio.Event().wait()

    flight.vehicle.jump = jump


def sends_a_hold(flight, then):
    """Fly; `then` is done while a jump waits; how many steps the hold took to leave."""
    vehicle, airframe, seen = flight.vehicle, flight.vehicle.airframe, {}
    unconfirmed_jumps(flight)

    def step():
        if "jump" in vehicle.verbs and "at_s" not in seen:
            seen["at_s"] = airframe.now_s
            then()
        if "hold" in vehicle.verbs and "held_s" not in seen:
            seen["held_s"] = airframe.now_s
            os.kill(os.getpid(), signal.SIGINT)
        assert airframe.now_s < 300.0

    vehicle.on_step = step
    flight.run()
    return round((seen["held_s"] - seen["at_s"]) / STEP_S)


def request_it(flight):
    flight.flight.commands.submit(HoldNow())


def replace_the_fence(flight):  # hands off, and a hold before
    flight.vehicle.callback(PlanReplaced(flight.vehicle.airframe.now_s, only_fence=True))


@pytest.mark.parametrize("why", [request_it, replace_the_fence])
def test_a_hold_does_not_wait_for_an_unconfirmed_jump(rig, why):
    flight = rig(duration_s=None)
    assert sends_a_hold(flight, lambda: why(flight)) <= 1
