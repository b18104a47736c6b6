"""No order leaves on an earlier mode: what is requested, what proves an answer, what is taken."""

import asyncio
import contextlib

import pytest

from air_router.errors import NotConfirmedError, NotSentError
from air_router.vehicle.px4.px4_commands import Px4Commands
from air_router.vehicle.px4.px4_motions import Px4Motions
from air_router.vehicle.vehicle import FlightMode, LinkSilent, TakenOverError
from geo.frame import Point
from sitl.rehearsal.companion import SimulatedLoop, World
from tests.air_router.vehicle.px4.conftest import HOLD, IN_AIR, LAND, MISSION, ON_GROUND, RETURN

POSITION = 3 << 16
STALLS_S = (0.25, 0.6, 1.0, 2.0)
PILOTS = {LAND: FlightMode.LAND, RETURN: FlightMode.RETURN, POSITION: FlightMode.POSITION}


class Wire:
    """The link to a PX4: it follows commands after `delay` turns, and answers requests.

    Attributes:
        sent: Names and commands of what left, without requests for the mode.
        echoes, answers: Whether it answers a TIMESYNC, and a request for a HEARTBEAT.
        chosen: What a pilot chooses as the next request comes in; None: nothing.
    """

    def __init__(self, px4, monkeypatch):
        self.px4, self.sent = px4, []
        self.echoes = self.answers = True
        self.chosen = None
        monkeypatch.setattr(px4.telemetry, "send", self.take)
        self.commands = Px4Commands(px4.telemetry)
        self.commands.listen()
        self.motions = Px4Motions(px4.mission, px4.telemetry, self.commands)

    def take(self, name, fields, *, to_all=False):
        command = fields.get("command")
        if name == "TIMESYNC":
            if self.chosen is not None:
                self.px4.mode, self.chosen = self.chosen, None
            if self.echoes:
                self.px4.sends("TIMESYNC", tc1=1, ts1=fields["ts1"])
        elif command == 512:
            if self.answers:
                self.px4.sends("HEARTBEAT")
        else:
            self.sent.append((name, command))
            self.follow(name, fields)

    def follow(self, name, fields):
        if fields.get("command") == 176:
            self.px4.mode = (int(fields["param2"]) << 16) | (int(fields["param3"]) << 24)
        elif fields.get("command") == 21:
            self.px4.mode = LAND
        elif fields.get("command") == 192:
            self.px4.mode = HOLD
        elif name == "MISSION_SET_CURRENT":
            self.px4.item = fields["seq"]

    def run(self, verb, *, while_it_waits=lambda: None):
        """Carry a verb out; the vehicle's time goes on while the loop waits."""
        return on_its_time(self.px4, verb, while_it_waits)


SPEED = ("COMMAND_LONG", 178)


async def flown(wire, *legs):
    """Fly legs; the vehicle acknowledges nothing, and the speed is sent once for each."""
    for leg in legs:
        with contextlib.suppress(NotConfirmedError):
            await leg()
        await asyncio.sleep(0.0)
        wire.motions.stop_sending_speed()
        await asyncio.sleep(0.0)


class VehicleTime(World):
    """The streams of a vehicle, ten times a second, as the time that the loop waits in."""

    def __init__(self, px4, tick):
        super().__init__(px4.wall_s)
        self._px4, self._tick = px4, tick

    def advance(self, until_s):
        self.now_s = min(until_s, self._px4.wall_s + 0.1)
        if self.now_s < until_s or self.now_s >= self._px4.wall_s + 0.1:
            self._tick()
            self._px4.run(0.1)
            self.now_s = self._px4.wall_s
        return []


def on_its_time(px4, work, tick=lambda: None):
    loop = SimulatedLoop(VehicleTime(px4, tick))
    try:
        return loop.run_until_complete(work)
    finally:
        loop.close()


@pytest.fixture
def wire(px4, monkeypatch):
    return Wire(px4, monkeypatch)


VERBS = {
    "hold": lambda motions: motions.hold(),
    "land": lambda motions: motions.land(),
    "jump": lambda motions: motions.jump(5),
    "reposition": lambda motions: motions.reposition(Point(40.0, 30.0), 40.0),
    "start": lambda motions: motions.start(),
}


@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.parametrize("chosen", PILOTS)
def test_no_order_leaves_over_a_mode_that_no_heartbeat_has_reported_yet(wire, verb, chosen):
    wire.chosen = chosen  # the last HEARTBEAT still has Mission
    with pytest.raises(TakenOverError) as caught:
        wire.run(VERBS[verb](wire.motions))
    assert (caught.value.mode, caught.value.sent, wire.sent) == (PILOTS[chosen], False, [])


def test_a_hold_that_the_pilot_chose_is_not_taken_for_the_one_that_is_about_to_leave(wire):
    wire.chosen = HOLD
    with pytest.raises(TakenOverError) as caught:
        wire.run(wire.motions.hold(out_of={FlightMode.MISSION}))
    assert (caught.value.mode, wire.sent) == (FlightMode.HOLD, [])
    wire.px4.mode = MISSION
    wire.px4.sends("HEARTBEAT")
    wire.chosen = HOLD  # as one of ours from before may show it
    wire.run(wire.motions.hold(out_of={FlightMode.MISSION, FlightMode.HOLD}))
    assert len(wire.sent) == 1


LEGS = {
    "jump": lambda motions, objection: motions.jump(5, objection),
    "reposition": lambda motions, objection: motions.reposition(Point(1.0, 2.0), 40.0, objection),
}


@pytest.mark.parametrize("leg", LEGS)
def test_the_objection_is_the_last_thing_before_each_message(wire, leg):
    """Also where the check of a leg takes longer than a received mode is good for."""
    wire.px4.mode = HOLD
    wire.px4.sends("HEARTBEAT")
    happened = []

    def objection():
        happened.append("objection")
        asyncio.get_running_loop().world.now_s += 0.05
        wire.px4.wall_s += 0.05

    take = wire.px4.telemetry.send
    wire.px4.telemetry.send = lambda name, fields, **more: (
        happened.append((name, fields.get("command"))) or take(name, fields, **more)
    )
    wire.run(flown(wire, lambda: LEGS[leg](wire.motions, objection)))
    orders = [order for order in wire.sent if order != SPEED]
    assert len(orders) == (2 if leg == "jump" else 1)
    for order in orders:
        assert happened[happened.index(order) - 1] == "objection"


@pytest.mark.parametrize(
    ("modes", "sent"), [((), False), ((HOLD,), True), ((POSITION, HOLD), True)]
)
def test_the_speed_is_sent_again_after_any_other_mode_in_the_air(wire, modes, sent):
    """Whoever chose Mission mode again: PX4 has forgotten the speed of the plan."""
    wire.px4.landed = ON_GROUND
    wire.px4.run(1.0)
    wire.px4.landed = IN_AIR  # it takes off in Mission mode
    for mode in (MISSION, *modes, MISSION):
        wire.px4.mode = wire.px4.intended = mode
        wire.px4.run(1.5)
    wire.run(flown(wire, lambda: wire.motions.jump(5)))
    assert (SPEED in wire.sent) is sent


def test_the_speed_of_a_flight_found_in_the_air_is_sent_with_its_first_jump(wire):
    wire.run(flown(wire, lambda: wire.motions.jump(5)))
    assert wire.sent == [("MISSION_SET_CURRENT", None), SPEED]


@pytest.mark.parametrize("verb", VERBS)
def test_no_order_leaves_while_a_failsafe_acts_in_the_mode_that_is_ours(wire, verb):
    """It holds because its fence was breached: the mode is that of our go-to."""
    wire.px4.mode = HOLD
    wire.px4.sends("HEARTBEAT")
    wire.px4.status = 5
    with pytest.raises(NotSentError, match="a failsafe of the autopilot acts"):
        wire.run(VERBS[verb](wire.motions))
    assert wire.sent == []


def test_an_order_leaves_at_once_when_the_vehicle_answers(wire):
    before_s = wire.px4.wall_s
    wire.run(wire.commands.recheck("a hold"))
    assert wire.px4.wall_s == before_s


def test_a_request_that_is_lost_is_sent_again(wire):
    wire.echoes = wire.answers = False
    requested_s = []

    def later():
        requested_s.append(wire.px4.wall_s)
        wire.echoes = wire.answers = len(requested_s) > 5

    wire.px4.off |= {"GLOBAL_POSITION_INT", "POSITION_TARGET_GLOBAL_INT", "SYSTEM_TIME"}
    wire.run(wire.motions.hold(), while_it_waits=later)
    assert wire.sent == [("COMMAND_LONG", 176)]
    assert len(requested_s) > 5


def test_nothing_leaves_where_no_mode_is_reported(wire):
    wire.answers = False
    wire.px4.off |= {"HEARTBEAT", "CURRENT_MODE"}
    with pytest.raises(NotSentError, match="no current flight mode was received"):
        wire.run(wire.motions.hold())
    assert wire.sent == []


def test_a_heartbeat_proves_nothing_before_what_was_sent_after_the_request(wire):
    """It was on its way, or in the socket, when the request left."""
    wire.echoes = False
    wire.px4.off |= {"GLOBAL_POSITION_INT", "POSITION_TARGET_GLOBAL_INT", "SYSTEM_TIME"}
    with pytest.raises(NotSentError):
        wire.run(wire.motions.hold())
    wire.px4.off.clear()  # their times prove it, too
    wire.run(wire.motions.hold())
    assert wire.sent == [("COMMAND_LONG", 176)]


def test_an_echo_of_an_earlier_request_proves_nothing(wire):
    wire.echoes = False
    wire.px4.off |= {"GLOBAL_POSITION_INT", "POSITION_TARGET_GLOBAL_INT", "SYSTEM_TIME"}

    def old_echo():
        wire.px4.sends("TIMESYNC", tc1=1, ts1=17)
        wire.px4.sends("TIMESYNC", tc1=0, ts1=1 << 60)  # a request of the vehicle's own

    with pytest.raises(NotSentError):
        wire.run(wire.motions.hold(), while_it_waits=old_echo)


@pytest.mark.parametrize("stall_s", STALLS_S)
def test_an_answer_that_waited_while_this_program_stood_still_is_requested_again(wire, stall_s):
    """The answer is in the socket as the program is stopped; the pilot chooses meanwhile."""

    async def script():
        wire.echoes = wire.answers = False
        order = asyncio.ensure_future(wire.motions.hold())
        await asyncio.sleep(0)
        px4, world = wire.px4, asyncio.get_running_loop().world
        px4.wall_s += stall_s
        world.now_s += stall_s
        px4.boot_s += stall_s
        px4.sends("TIMESYNC", tc1=1, ts1=1 << 60)  # kept: answers of before
        px4.sends("HEARTBEAT")
        wire.echoes = wire.answers = True
        px4.mode = RETURN
        for _ in range(20):
            await asyncio.sleep(0)
        with pytest.raises(TakenOverError):
            await order

    wire.run(script())
    assert wire.sent == []


@pytest.mark.parametrize("stall_s", STALLS_S)
@pytest.mark.parametrize("chosen", PILOTS)
def test_after_a_standstill_the_modes_that_were_kept_are_reported_and_none_counts_as_of_now(
    px4, stall_s, chosen
):
    """RTL, then Hold by an order of ours that was on its way: both were in the socket."""
    px4.events.clear()
    px4.wall_s += stall_s
    px4.sends("GLOBAL_POSITION_INT")  # of the beginning of the gap: it has the time of then
    px4.sends("CURRENT_MODE", custom_mode=chosen, intended_custom_mode=chosen)
    px4.sends("HEARTBEAT", custom_mode=HOLD)
    modes = [event.mode for event in px4.events if hasattr(event, "mode")]
    assert modes == [PILOTS[chosen], FlightMode.HOLD]
    assert any(isinstance(event, LinkSilent) and event.over for event in px4.events)
    assert px4.last.ages.mode_s > 0.0
    px4.boot_s += stall_s
    px4.sends("GLOBAL_POSITION_INT")  # of now
    px4.sends("HEARTBEAT", custom_mode=HOLD)
    assert px4.telemetry.snapshot().ages.mode_s == 0.0


STATES = {
    "GLOBAL_POSITION_INT": lambda telemetry: (telemetry.position, telemetry.altitude_m),
    "POSITION_TARGET_GLOBAL_INT": lambda telemetry: telemetry.target,
    "MISSION_CURRENT": lambda telemetry: telemetry.item,
    "EXTENDED_SYS_STATE": lambda telemetry: telemetry.in_air,
    "SYS_STATUS": lambda telemetry: telemetry.battery,
    "GPS_RAW_INT": lambda telemetry: telemetry.fix,
}


def is_another(px4):
    """All that the vehicle reports is otherwise from now on, but its mode."""
    px4.east_m, px4.height_m = 50.0, 60.0
    px4.item, px4.landed, px4.battery, px4.fix = 7, ON_GROUND, 3, 0


@pytest.mark.parametrize("stall_s", STALLS_S)
@pytest.mark.parametrize("name", STATES)
def test_after_a_standstill_no_state_of_before_is_believed(px4, name, stall_s):
    """What the socket kept is of the beginning of the gap; it is believed as of now."""
    before = STATES[name](px4.telemetry.snapshot())
    ids = px4.telemetry.plan.ids
    px4.wall_s += stall_s
    px4.sends("GLOBAL_POSITION_INT", time_boot_ms=round(px4.boot_s * 1e3) + 20)
    is_another(px4)
    if name != "GLOBAL_POSITION_INT":
        px4.sends(name, mission_id=99)
    assert STATES[name](px4.telemetry.snapshot()) == before
    assert px4.telemetry.plan.ids == ids
    px4.boot_s += stall_s
    px4.sends("GLOBAL_POSITION_INT")
    px4.sends(name, mission_id=99)
    px4.run(0.8)  # it has its place by messages that agree
    px4.sends(name, mission_id=99)
    assert STATES[name](px4.telemetry.snapshot()) != before


@pytest.mark.parametrize("stall_s", STALLS_S)
def test_a_home_that_was_moved_in_a_standstill_is_reported(px4, stall_s):
    before = px4.telemetry.place.home
    px4.wall_s += stall_s
    px4.sends("GLOBAL_POSITION_INT", time_boot_ms=round(px4.boot_s * 1e3) + 20)
    px4.sends("HOME_POSITION", latitude=399_500_000, longitude=-751_900_000, altitude=9000)
    assert px4.telemetry.place.home != before


@pytest.mark.parametrize("stall_s", STALLS_S)
def test_after_a_standstill_the_time_has_gone_on(px4, stall_s):
    """Timers that are due in it are due: what the socket kept does not turn the time back."""
    before_s = px4.clock.boot_s()
    px4.wall_s += stall_s
    assert px4.clock.boot_s() == pytest.approx(before_s + stall_s, abs=0.1)
    px4.sends("GLOBAL_POSITION_INT", time_boot_ms=round(px4.boot_s * 1e3) + 20)
    assert px4.clock.boot_s() == pytest.approx(before_s + stall_s, abs=0.1)


def test_a_mode_that_shows_between_an_order_and_its_confirmation_is_the_pilots(wire):
    wire.follow = lambda _name, _fields: setattr(wire.px4, "mode", RETURN)
    with pytest.raises(TakenOverError) as caught:
        wire.run(wire.motions.hold())
    assert (caught.value.mode, caught.value.sent) == (FlightMode.RETURN, True)
    assert len(wire.sent) == 1


def test_an_order_does_not_leave_again_over_a_mode_that_no_heartbeat_has_reported_yet(wire):
    wire.follow = lambda _name, _fields: None  # it was lost
    turns = []

    def pilot():
        turns.append(None)
        if len(turns) == 8:
            wire.chosen = LAND

    with pytest.raises(TakenOverError) as caught:
        wire.run(wire.motions.hold(), while_it_waits=pilot)
    assert (caught.value.mode, caught.value.sent) == (FlightMode.LAND, True)  # the first may come
    assert wire.sent == [("COMMAND_LONG", 176)]
