"""Our autopilot holds to every recorded conversation; and a departure is noticed and reported."""

import json
import socket
import threading

import pytest

from air_router.vehicle.px4.versions import FACTS, FLOWN, name_of
from sitl.cli import cli
from sitl.conformance.conversation import (
    VERBS,
    Conversation,
    cases_of,
    conversations,
    converse,
    in_version,
    reported_version,
    run_steps,
)
from sitl.conformance.session import DepartureError, LinkKind, LocalLine, Session, UdpLine
from sitl.mavlink.codec import Sender
from sitl.mavlink.vehicle import VehicleSettings
from sitl.process.vehicle import LinkAddresses, Ports, VehicleProcess
from sitl.px4sim.versions import BEHAVIOURS, RECORDED, USUAL
from tests.sitl.prepared import HOME, local_line, ready_for, ready_to_hold

pytestmark = pytest.mark.long

CONVERSATIONS = conversations()


IN_EVERY_VERSION = {
    *("every-mode-on-the-ground", "mission-upload-and-download", "same-plan-again", "landing"),
    *("mission-from-the-ground", "checks-requested"),
}
"""What the player itself expects otherwise: answers to a mode, requests, mission_state."""


def differs(one, version):
    """Whether a conversation is otherwise in this version than in 1.17."""
    return not one.is_held_with(RECORDED) or any(
        in_version(step, version) != in_version(step, RECORDED) for step in one.steps
    )


@pytest.mark.parametrize(
    "one", [one for one in CONVERSATIONS if one.is_held_with(USUAL)], ids=lambda one: one.name
)
def test_our_autopilot_holds_to(one):
    run_steps(ready_to_hold(one), one.steps)


@pytest.mark.parametrize(
    ("version", "one"),
    [
        pytest.param(version, one, id=f"{name_of(version)}-{one.name}")
        for version in BEHAVIOURS
        if version != USUAL
        for one in CONVERSATIONS
        if one.is_held_with(version) and (differs(one, version) or one.name in IN_EVERY_VERSION)
    ],
)
def test_as_another_version_it_holds_to(version, one):
    run_steps(ready_to_hold(one, version), one.steps)


def test_every_one_states_where_its_fact_is_from():
    assert len(CONVERSATIONS) == 149
    assert all(one.fact and one.recorded and one.steps for one in CONVERSATIONS)


def test_every_version_that_was_flown_can_be_simulated():
    assert set(BEHAVIOURS) == set(FLOWN)


def test_every_fact_that_a_flight_rests_on_has_a_conversation_that_shows_it():
    assert {fact.conversation for fact in FACTS} <= {one.name for one in CONVERSATIONS}


def test_every_verb_is_needed():
    assert {next(iter(step)) for one in CONVERSATIONS for step in one.steps} | {"take off"} == set(
        VERBS
    )


class TestVersions:
    """A step states what is different in which version of PX4; what is written is of 1.17."""

    @pytest.mark.parametrize(
        ("version", "wanted"),
        [
            ((1, 16), {"go to": (20, 0, 15), "answer": "UNSUPPORTED"}),
            ((1, 17), {"go to": (20, 0, 15), "answer": "UNSUPPORTED"}),
            ((1, 18), {"go to": (20, 0, 15), "answer": "ACCEPTED"}),
        ],
    )
    def test_other_terms(self, version, wanted):
        changed = {"since 1.18": {"answer": "ACCEPTED", "because": "Commander.cpp"}}
        step = {"go to": (20, 0, 15), "answer": "UNSUPPORTED"} | changed
        assert in_version(step, version) == wanted

    def test_no_step_at_all(self):
        step = {"wait": 3.0, "before 1.17": {"left out": "it does not wait"}}
        assert in_version(step, (1, 16)) is None
        assert in_version(step, (1, 17)) == {"wait": 3.0}

    def test_one_that_is_not_for_a_version(self):
        case = "one:\n- {on the ground: A fact (here), since: '1.18'}\n- {wait: 1}\n"
        (one,) = cases_of(case)
        assert [one.is_held_with((1, minor)) for minor in (17, 18)] == [False, True]

    def test_a_vehicle_reports_its_version(self):
        assert reported_version(local_line()) == USUAL

    def test_a_vehicle_of_another_version_departs(self):
        step = {"set mode": "AUTO_LOITER"}
        session = ready_for(version=RECORDED)
        session.version = (1, 18)
        with pytest.raises(DepartureError, match=r"received \['ACCEPTED', 'ACCEPTED'\]"):
            run_steps(session, [step])


class LateLine:
    """To a vehicle that frames reach some simulated seconds later, as a fast one."""

    def __init__(self, late_s, time_scale):
        self._line, self._sent = local_line(), []
        self._late_s, self.time_scale = late_s, time_scale
        self.links = self._line.links

    @property
    def now_s(self):
        return self._line.now_s

    def send(self, link, frame):
        self._sent.append((self.now_s + self._late_s, link, frame))

    def listen(self):
        while self._sent and self._sent[0][0] <= self.now_s:
            self._line.send(*self._sent.pop(0)[1:])
        return self._line.listen()


def test_a_target_without_a_system_is_the_vehicle_whatever_its_number():
    settings = VehicleSettings(HOME, system_id=5, ground_link=False)
    step = {"command": "REQUEST_MESSAGE", "params": (148,), "target": (None, 0)}
    run_steps(Session(LocalLine(settings), USUAL), [{"wait": 3.0}, step])
    others = step | {"target": (1, 0)}
    with pytest.raises(DepartureError, match=r"received \[\]"):
        run_steps(Session(LocalLine(settings), USUAL), [{"wait": 3.0}, others])


@pytest.mark.parametrize(
    ("late_s", "step"),
    [
        (1.5, {"command": "REQUEST_MESSAGE", "params": (148,)}),
        (1.5, {"parameter": "NAV_DLL_ACT", "value": 0}),
        (3.5, {"upload": [{"at": (10, 0)}, {"at": (20, 0)}]}),
    ],
    ids=["command", "parameter", "upload"],
)
def test_an_answer_takes_its_time_by_the_walls_clock(late_s, step):
    """At five times real time a PX4 on a busy machine answers after more than a second of its."""
    steps = [{"wait": 3.0}, step]
    run_steps(Session(LateLine(late_s, time_scale=5.0), USUAL), steps)
    with pytest.raises(DepartureError, match=r"received|no reply"):
        run_steps(Session(LateLine(late_s, time_scale=1.0), USUAL), steps)


class TestDepartures:
    @pytest.mark.parametrize(
        "step",
        [
            {"command": "COMPONENT_ARM_DISARM", "params": (1,), "answers": ("DENIED",)},
            {"command": 31999, "answers": ()},
            {"set mode": "AUTO_RTL", "result": "DENIED"},
            {"go to": (20, 0, 15), "answer": "DENIED"},
            {"expect": "PING", "within_s": 0.5},
            {"expect": "EXTENDED_SYS_STATE", "fields": {"landed_state": 2}, "within_s": 0.5},
            {"nothing": "HEARTBEAT", "for_s": 2.0},
            {"text": "never announced", "within_s": 0.5},
            {"event": "never_sent", "within_s": 0.5},
            {"mode": "AUTO_LAND", "within_s": 0.5},
            {"mode": "AUTO_LOITER", "armed": True, "within_s": 1.5},
            {"mode": "AUTO_LOITER", "intended": "AUTO_LAND"},
            {"stays in": "AUTO_LAND", "for_s": 1.0},
            {"upload": [{"at": (10, 0)}], "result": "ERROR"},
            {"upload": [{"at": (10, 0), "frame": 1}]},
            {"download": [{"command": "NAV_WAYPOINT"}]},
            {"mission": {"seq": 7}, "within_s": 1.0},
            {"count": "MISSION_REQUEST_INT", "fields": {"seq": 0}, "for_s": 0.5, "between": (1, 2)},
            {"disarmed": (5.0, 6.0)},
            {"arrives": (50,), "within_s": 0.5},
            {"strays": (5.0, 6.0), "for_s": 1.0},
            {"furthest north": (40.0, 50.0), "for_s": 1.0},
            {"speed": (5.0, 6.0), "for_s": 1.0},
            {"climb": (1.0, 2.0), "for_s": 1.0},
            {"turns": (10.0, 20.0), "for_s": 1.0},
            {"set parameter": "GF_ACTION", "value": 3, "answers": 1},
            {"parameter": "GF_ACTION", "value": 3},
            {"parameter": "GF_ACTION", "value": None},
            {"all parameters": (), "fewest": 1000, "within_s": 2.0},
            {"rates": {"HEARTBEAT": (5, 6)}, "for_s": 2.0},
        ],
        ids=lambda step: "-".join(map(str, next(iter(step.items())))).replace(" ", "-"),
    )
    def test_is_noticed(self, step):
        with pytest.raises(DepartureError, match=f"^{next(iter(step))} .*(expected|got stuck)"):
            run_steps(ready_for(), [step])

    def test_is_the_outcome(self):
        step = {"stays in": "AUTO_LAND", "for_s": 1.0}
        outcome = converse(Conversation("test", "a fact", "here", (step,)), local_line(), USUAL)
        assert not outcome.held
        assert outcome.departure.startswith("stays in AUTO_LAND: expected")

    def test_no_answer(self, monkeypatch):
        monkeypatch.setattr("sitl.conformance.session._SILENCE_S", 0.05)
        silent = UdpLine({LinkKind.API: 0})
        try:
            outcome = converse(Conversation("test", "a fact", "here", ()), silent, USUAL)
        finally:
            silent.close()
        assert "no vehicle sends" in outcome.departure


def test_a_conversation_is_held_over_udp():
    """With a vehicle as a process would run it."""
    line = UdpLine({LinkKind.API: 0})
    here = line._sockets[LinkKind.API].getsockname()
    ports = Ports(LinkAddresses(("", 0), here), None, LinkAddresses(("", 0), ("127.0.0.1", 9)))
    settings = VehicleSettings(HOME, speed=20.0, system_id=7, ground_link=False)
    stop = threading.Event()
    with VehicleProcess(settings, ports) as process:
        runner = threading.Thread(target=process.run, args=(stop.is_set,))
        runner.start()
        try:
            (one,) = (one for one in CONVERSATIONS if one.name == "arm-twice")
            outcome = converse(one, line, USUAL)
        finally:
            stop.set()
            runner.join()
            line.close()
    assert outcome.held, outcome.departure


def test_another_vehicle_that_sends_to_the_same_port_is_not_taken_for_it():
    """All PX4s of a machine send to the ground station's port: commands went to another then."""
    line = UdpLine({LinkKind.API: 0}, system_id=7)
    port = line._sockets[LinkKind.API].getsockname()
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
            received = []
            for system_id in (3, 7):
                beat = Sender(system_id).pack_values("HEARTBEAT", {"type": 2, "autopilot": 12})
                end.sendto(beat, port)
            while not received:
                received = line.listen()
        assert [frame.system_id for _, frame in received] == [7]
    finally:
        line.close()


class TestCommandLine:
    def test_outcomes_as_json(self, capsys):
        assert cli.main(["conform", "arm-twice", "unknown-commands", "--json"]) == 0
        printed = capsys.readouterr()
        rows = json.loads(printed.out)
        assert [(row["name"], row["held"]) for row in rows] == [
            ("arm-twice", True),
            ("unknown-commands", True),
        ]
        assert "2 held, 0 departed" in printed.err

    def test_list(self, capsys):
        assert cli.main(["conform", "--list"]) == 0
        assert len(capsys.readouterr().out.splitlines()) == len(CONVERSATIONS)

    def test_nothing_of_that_name(self, capsys):
        assert cli.main(["conform", "no-such-conversation"]) == 2
        assert "sitl conform --list" in capsys.readouterr().err
