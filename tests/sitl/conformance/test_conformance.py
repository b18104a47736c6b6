"""Our autopilot holds to every recorded conversation; and a departure is noticed and told."""

import json
import socket
import threading

import pytest

from air_router.errors import ExitCode
from sitl.cli import cli
from sitl.conformance.conversation import (
    Conversation,
    Outcome,
    Start,
    beside,
    conversations,
    converse,
)
from sitl.conformance.interpreter import VERBS, run_steps
from sitl.conformance.line import Link, SilentVehicleError, UdpLine
from sitl.mavlink.mavlink_vehicle import VehicleSettings
from sitl.mavlink.udp_link import PortInUseError
from sitl.process.vehicle import Ports, VehicleProcess
from tests.sitl.prepared import HOME, local_line, ready_for

CONVERSATIONS = conversations()


def held(*steps, version="1.17", **options):
    return converse(Conversation("test", "a fact", "here", steps, **options), local_line(version))


@pytest.mark.parametrize("one", CONVERSATIONS, ids=lambda one: one.name)
def test_our_autopilot_holds_to(one):
    run_steps(ready_for(one.start, one.parameters, one.links, steps=one.steps), one.steps)


def test_every_one_says_where_its_fact_is_from():
    assert len(CONVERSATIONS) == 157
    assert all(one.fact and one.recorded and one.steps for one in CONVERSATIONS)


def test_every_verb_is_needed():
    assert {next(iter(step)) for one in CONVERSATIONS for step in one.steps} | {"take off"} == set(
        VERBS
    )


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
            {"text": "never said", "within_s": 0.5},
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
            {"set parameter": "GF_ACTION", "value": 3, "answers": 1},
            {"parameter": "GF_ACTION", "value": 3},
            {"parameter": "GF_ACTION", "value": None},
            {"all parameters": (), "fewest": 1000, "within_s": 2.0},
            {"rates": {"HEARTBEAT": (5, 6)}, "for_s": 2.0},
        ],
        ids=lambda step: "-".join(map(str, next(iter(step.items())))).replace(" ", "-"),
    )
    def test_is_noticed(self, step):
        outcome = held(step)
        assert not outcome.held
        assert outcome.departure.startswith(next(iter(step)))
        assert "expected" in outcome.departure or "got stuck" in outcome.departure

    def test_a_link_that_is_not_there_is_left_out(self):
        wanted = Conversation("test", "a fact", "here", (), links=frozenset(Link))
        outcome = converse(wanted, local_line())
        assert outcome.left_out
        assert "GCS" in outcome.departure

    def test_no_answer(self, monkeypatch):
        monkeypatch.setattr("sitl.conformance.line._SILENCE_S", 0.05)
        silent = UdpLine({Link.API: 0}, fresh=True)
        try:
            outcome = converse(Conversation("test", "a fact", "here", ()), silent)
        finally:
            silent.close()
        assert "no vehicle sends" in outcome.departure
        assert isinstance(SilentVehicleError("x"), Exception)


class TestOverUdp:
    @pytest.fixture
    def vehicle(self):
        """One vehicle as a process would run it, for several conversations."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        ports = Ports(("", 0), ("127.0.0.1", port), ("", 0), None, ("", 0), ("127.0.0.1", 9))
        settings = VehicleSettings(HOME, speed=10.0, system_id=7, ground_link=False)
        stop = threading.Event()
        with VehicleProcess(settings, ports) as process:
            runner = threading.Thread(target=process.run, args=(stop.is_set,))
            runner.start()
            yield port
            stop.set()
            runner.join()

    def test_conversations_follow_each_other_on_one_vehicle(self, vehicle, capsys):
        names = ("fence-around-home", "arm-twice", "goto-into-a-zone")
        code = cli.main(["conform", *names, "--connect", f"udpin://127.0.0.1:{vehicle}", "--json"])
        said = capsys.readouterr()
        rows = json.loads(said.out)
        assert code == 0, said.err
        assert {row["name"]: row["held"] for row in rows} == dict.fromkeys(names, True)

    def test_one_that_needs_a_fresh_vehicle_is_left_out(self, vehicle, capsys):
        url = f"udpin://127.0.0.1:{vehicle}"
        assert cli.main(["conform", "arming-before", "--connect", url, "--json"]) == 0
        assert json.loads(capsys.readouterr().out)[0]["left_out"]


class TestVersions:
    def test_1_18_answers_a_mode_change_once(self):
        assert held({"set mode": "AUTO_LAND"}, version="1.18").held
        assert held({"command": "DO_SET_MODE", "params": (1, 4, 6)}, version="1.18").held

    def test_1_18_knows_do_set_mission_current(self):
        steps = (
            {"upload": [{"at": (10, 0)}, {"at": (20, 0)}]},
            {"mission": {"mission_state": 2}},
            {"command": "DO_SET_MISSION_CURRENT", "params": (1,)},
            {"mission": {"seq": 1}},
            {"command": "DO_SET_MISSION_CURRENT", "params": (9,), "answers": ("DENIED",)},
        )
        outcome = held(*steps, version="1.18")
        assert outcome.held, outcome.departure

    def test_what_only_1_17_does_is_left_out(self):
        assert held({"wait": 1}, version="1.18", until=[1, 17]).left_out
        assert held({"wait": 1}, since=[1, 18]).left_out


class TestCommandLine:
    def test_outcomes_as_json(self, capsys):
        assert cli.main(["conform", "arm-twice", "unknown-commands", "--json"]) == 0
        said = capsys.readouterr()
        rows = json.loads(said.out)
        assert [(row["name"], row["held"]) for row in rows] == [
            ("arm-twice", True),
            ("unknown-commands", True),
        ]
        assert "2 held, 0 departed" in said.err

    def test_list(self, capsys):
        assert cli.main(["conform", "--list"]) == 0
        assert len(capsys.readouterr().out.splitlines()) == len(CONVERSATIONS)

    def test_beside_another_run(self, tmp_path, capsys):
        other = tmp_path / "other.json"
        cli.main(["conform", "arm-twice", "--json"])
        other.write_text(capsys.readouterr().out)
        assert cli.main(["conform", "arm-twice", "--beside", str(other)]) == 0
        assert "| arm-twice |" in capsys.readouterr().out

    def test_nothing_of_that_name(self, capsys):
        assert cli.main(["conform", "no-such-conversation"]) == 2
        assert "sitl conform --list" in capsys.readouterr().err

    @pytest.mark.parametrize("text", ["{}", "[1]", "nonsense"])
    def test_a_file_that_is_no_run(self, tmp_path, capsys, text):
        other = tmp_path / "other.json"
        other.write_text(text)
        code = cli.main(["conform", "arm-twice", "--beside", str(other)])
        assert code == 2 or text == "{}"

    @pytest.mark.parametrize("url", ["tcp://1.2.3.4:5", "udpin://0.0.0.0", "udpin://0.0.0.0:x"])
    def test_a_wrong_address(self, capsys, url):
        assert cli.main(["conform", "--connect", url]) == 2
        assert "udpin://127.0.0.1:14540" in capsys.readouterr().err

    def test_the_table_shows_departures(self):
        conversation = Conversation("one", "a fact", "here", (), start=Start.GROUND)
        ours = [Outcome("one", held=True, notes=("a|b",))]
        theirs = [Outcome("one", held=False, departure="it did not")]
        table = beside((conversation,), ours, theirs)
        assert "**departs**: it did not" in table
        assert "a\\|b" in table


def test_a_port_that_is_taken_is_one_error_and_no_departure():
    first = UdpLine({Link.API: 0, Link.GROUND: 0}, fresh=True)
    try:
        port = first._sockets[Link.GROUND].getsockname()[1]
        with pytest.raises(
            PortInUseError, match=f"UDP port {port}, .*; end the ground station"
        ) as e:
            UdpLine({Link.API: 0, Link.GROUND: port}, fresh=True)
    finally:
        first.close()
    assert e.value.exit_code is ExitCode.NO_VEHICLE
