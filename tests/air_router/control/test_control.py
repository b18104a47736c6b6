"""Requests of other programs, over ZeroMQ from a thread, to a live flight in this process."""

import asyncio
import dataclasses
import json
import random
import re
import stat
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
import zmq
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from air_router.cli.cli import main
from air_router.control.command_request import (
    COSTLY_AT_ONCE,
    MAX_BYTES,
    MODELS,
    Budget,
    command_request_of,
    parse_command,
)
from air_router.control.control import (
    CONTROL_NAME,
    ControlClient,
    ControlError,
    ControlUnreachableError,
    endpoint_of,
)
from air_router.control.control_server import ControlServer
from air_router.controller.model.requests import ChangeAltitude, ComeHome, GoTo, HoldNow
from air_router.errors import ExitCode
from air_router.flight.flight_loop import CommandService
from air_router.flight.mission_reloader import ReloadReport
from air_router.sim import sim
from air_router.sim.sim_world import SimVehicle
from geo.frame import Point
from mocha_link import ListenError, PortInUseError
from mocha_link.errors import RequestError
from mocha_link.service.endpoint import connect
from tests.command_lines import options_for
from tests.mocha_link.libzmq import bind


class Served:
    """The control endpoint of a pretended flight in the air, at an endpoint of its own thread."""

    def __init__(self, flight, endpoint):
        self.flight = flight
        self.deeds = []
        self.failures = []
        self.readings = []
        self.clock = time.monotonic
        self.endpoint = endpoint
        self._ready = threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._run()))

    async def _run(self):
        command_service = CommandService(
            self.flight.mission.frame,
            self.flight.controller.status,
            self._deliver,
            lambda: self.readings.pop(0) if self.readings else None,
        )
        server = ControlServer(self.endpoint, command_service.execute, monotonic=self._now_s)
        server.open()
        self.endpoint = server.endpoint
        self._loop, self._stop = asyncio.get_running_loop(), asyncio.Event()
        running = asyncio.ensure_future(server.run())
        self._ready.set()
        stopping = asyncio.ensure_future(self._stop.wait())
        await asyncio.wait({running, stopping}, return_when=asyncio.FIRST_COMPLETED)
        if running.done():
            self.failures.append(running.exception())
        running.cancel()
        server.close()

    def _now_s(self):
        return self.clock()

    def _deliver(self, request):
        self.deeds.append(request)
        before = len(self.flight.actions)
        self.flight.give(request)
        return self.flight.actions[before:]

    def __enter__(self):
        self._thread.start()
        assert self._ready.wait(60)
        return self

    def __exit__(self, *_):
        self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join()
        assert self.failures == []


@pytest.fixture(params=["tcp://127.0.0.1:*"])
def served(airborne, request):
    flight = airborne()
    with Served(flight, endpoint_of(request.param)) as serving:
        yield serving


@pytest.fixture
def client(served):
    with ControlClient(served.endpoint, by="a test", timeout_s=30) as client:
        yield client


def place(flight, point):
    return tuple(flight.mission.frame.to_geodetic(point))


def test_every_verb_of_the_client(served, client):
    flight = served.flight
    near, outside = Point(75.0, -150.0), Point(0.0, 5000.0)
    assert client.status()["state"] == "INIT"
    answer = client.goto([place(flight, near)], hold_s=5.0)
    assert (answer.accepted, answer.code, answer.state) == (True, None, "GOTO")
    assert answer.points[0] == pytest.approx(place(flight, near), abs=1e-7)
    assert client.status()["points_left"] == 1
    answer = client.goto([place(flight, near), place(flight, outside)])
    assert (answer.accepted, answer.code) == (False, "outside-fence")
    assert answer.why == "point 2 lies outside the fence"
    assert client.seek("phantom").code == "unknown-robot"
    assert client.seek("io").state == "SEARCH"
    assert client.hold().state == "HOLD"
    assert client.altitude(55.0).code == "altitude"
    assert client.resume().accepted
    assert client.explore().state == "EXPL"
    assert client.home().why == "it comes home"
    assert {request.by for request in served.deeds} == {"a test"}
    situation = client.status()
    assert {"position", "battery", "in_charge", "time_left_s", "goal"} <= situation.keys()


def test_an_unknown_request_is_an_error_and_the_client_goes_on(client):
    for values in (
        {"request": "dance"},
        {"request": "hold", "robot": "io"},
        {"request": "goto", "points": [[91.0, 0.0]]},
    ):
        with pytest.raises(ControlError):
            client.request(values)
    assert client.hold().accepted


def test_ways_are_not_planned_without_end_but_a_hold_is_always_received(served, client):
    point = place(served.flight, Point(75.0, -150.0))
    now_s = 0.0
    served.clock = lambda: now_s
    for _ in range(int(COSTLY_AT_ONCE)):
        assert client.goto([point]).accepted
    with pytest.raises(ControlError, match="too many requests") as caught:
        client.goto([point])
    assert caught.value.again
    assert client.hold().accepted
    now_s = 1.0
    assert client.goto([point]).accepted


def test_many_points_count_as_many_requests(served, client):
    points = [place(served.flight, Point(75.0, -150.0))] * 40
    served.clock = lambda: 0.0
    for _ in range(2):
        assert client.goto(points).accepted
    with pytest.raises(ControlError, match="too many requests"):
        client.goto(points)
    assert client.goto(points[:3]).accepted


class Fuzzer:
    def __init__(self, seed):
        self._random = random.Random(seed)

    def frames(self, texts):
        chance = self._random
        good = json.dumps({"request": "hold", "id": 5}).encode()
        kinds = (
            lambda: [chance.randbytes(chance.randrange(200))],
            lambda: [good[: chance.randrange(len(good))]],
            lambda: [good, *[b"x" * chance.randrange(50) for _ in range(chance.randrange(1, 40))]],
            list,
            lambda: [b""],
            lambda: [b'{"request":"hold","by":"' + b"y" * (MAX_BYTES + chance.randrange(999))],
            lambda: [b"[" * 50_000],
            lambda: [b'{"a":' * 9_000],
            lambda: [b'{"request":"goto","points":[[1e999,NaN]]}'],
            lambda: [b'{"request":"goto","points":' + b"[[1,2]]" * 3 + b"}"],
            lambda: [b'{"request":"goto","points":[' + b"[1,2]," * 9_000 + b"[1,2]]}"],
            lambda: [b'{"request":"seek","robot":"' + "\x00\x1b[2J\N{SKULL}".encode() + b'"}'],
            lambda: [b'{"request":"hold","id":' + b"9" * 5_000 + b"}"],
            lambda: [b'{"request":"hold","id":{"a":1}}'],
            lambda: [b'{"request":"hold\xff"}'],
            lambda: [json.dumps(texts).encode()],
        )
        return chance.choice(kinds)()


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda part: (
        st.lists(part, max_size=3) | st.dictionaries(st.text(max_size=8), part, max_size=3)
    ),
    max_leaves=6,
)
FIELDS = st.fixed_dictionaries(
    {"request": st.sampled_from([*MODELS, "", "Hold"])},
    optional={"id": JSON, "by": JSON, "robot": JSON, "points": JSON, "hold_s": JSON, "x": JSON},
)


@settings(suppress_health_check=[HealthCheck.too_slow])
@given(values=FIELDS | JSON)
def test_whatever_json_comes_is_a_request_or_a_complaint(values):
    try:
        command = command_request_of(values)
    except RequestError as error:
        complaint = str(error)
    else:
        complaint = command.request
    assert complaint
    assert complaint.isprintable()


def test_whatever_frames_come_cost_an_error_reply_and_nothing_else(served, monkeypatch):
    monkeypatch.setattr("air_router.control.control_server.PER_S", 5000.0)
    fuzzer = Fuzzer(7)
    with zmq.Context() as context, context.socket(zmq.DEALER) as hostile:
        hostile.setsockopt(zmq.LINGER, 0)
        connect(hostile, served.endpoint)
        for number in range(400):
            frames = fuzzer.frames([number])
            if not frames:
                continue
            hostile.send_multipart(frames)
            assert hostile.poll(20_000), frames
            reply = json.loads(hostile.recv_multipart()[-1])
            assert reply["ok"] is False or reply["code"] == "unknown-robot"
    assert {type(deed).__name__ for deed in served.deeds} <= {"SeekNow"}  # of a robot unknown
    with ControlClient(served.endpoint, timeout_s=30) as client:
        assert client.hold().accepted


def test_what_is_too_large_to_be_read_costs_its_sender_the_connection(served):
    with zmq.Context() as context, context.socket(zmq.DEALER) as hostile:
        hostile.setsockopt(zmq.LINGER, 0)
        with hostile.get_monitor_socket(zmq.EVENT_DISCONNECTED) as parted:
            connect(hostile, served.endpoint)
            hostile.send(b"x" * 10_000_000)
            assert parted.poll(20_000)
            hostile.disable_monitor()
    with ControlClient(served.endpoint, timeout_s=30) as client:
        assert client.status()["ok"]


@pytest.mark.parametrize("served", [CONTROL_NAME], indirect=True)
def test_the_usual_endpoint_is_for_its_user_only(served):
    path = Path(served.endpoint.removeprefix("ipc://"))
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert stat.S_IMODE(path.parent.stat().st_mode) == 0o700
    with ControlClient(timeout_s=30) as client:
        assert client.hold().accepted


def test_an_endpoint_that_others_reach_is_refused():
    assert endpoint_of("24700") == "tcp://127.0.0.1:24700"
    assert endpoint_of("tcp://localhost:1") == "tcp://127.0.0.1:1"
    assert endpoint_of("ipc:///tmp/x") == "ipc:///tmp/x"
    for text in (
        "tcp://*:1",
        "tcp://0.0.0.0:1",
        "tcp://10.0.0.1:1",
        "tcp://1",
        "udp://x",
        "",
        "./x",
    ):
        with pytest.raises(ValueError, match=r"no endpoint|other machines"):
            endpoint_of(text)


def test_of_several_simulated_uavs_each_has_its_own_endpoints():
    def options(*more):
        arguments = options_for(sim.run, "m.yaml", *more)
        seats = [SimVehicle(name, "udp://x", 1, "tcp://y") for name in ("titan", "atlas")]
        world = SimpleNamespace(team=Path("t"), pace=None)
        commands = [sim.command_of(seat, n, world, arguments) for n, seat in enumerate(seats)]
        names = ("--metrics", "--control", "--web", "--web-host")
        return [
            [command[command.index(name) + 1] for name in names if name in command]
            for command in commands
        ]

    assert options() == [[], []]
    given = ("--metrics", "tcp://127.0.0.1:5", "--control", "ipc:///c", "--web", "80")
    assert options(*given) == [
        ["tcp://127.0.0.1:5", "ipc:///c", "81"],  # behind the page of all
        ["tcp://127.0.0.1:6", "ipc:///c-2", "82"],
    ]
    assert options("--control", "*", "--web", "0") == [["tcp://127.0.0.1:*", "0"]] * 2


def test_an_endpoint_that_is_taken_is_one_clear_error():
    async def two():
        first = ControlServer("tcp://127.0.0.1:*", lambda *_: {})
        first.open()
        try:
            with pytest.raises(PortInUseError, match="cannot take requests"):
                ControlServer(first.endpoint, lambda *_: {}).open()
            with pytest.raises(ListenError):
                ControlServer("tcp://127.0.0.1:x", lambda *_: {}).open()
        finally:
            first.close()
            first.close()

    asyncio.run(two())


def test_ask_as_a_command(served, capsys):
    port = served.endpoint.rpartition(":")[2]
    assert main(["ask", port, "goto", "-33.9,151.2"]) == ExitCode.REFUSED
    assert "refused [outside-fence]" in capsys.readouterr().out
    spot = "{},{}".format(*place(served.flight, Point(75.0, -150.0)))
    assert main(["ask", port, "goto", f"{spot},{spot}", "--hold-s", "3", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert (answer["accepted"], len(answer["points"])) == (True, 2)
    assert main(["ask", port, "status"]) == 0
    assert "state" in capsys.readouterr().out
    assert main(["ask", port, "seek"]) == ExitCode.USAGE
    assert main(["ask", port, "goto", "1"]) == ExitCode.USAGE
    assert main(["ask", port, "altitude", "high"]) == ExitCode.USAGE
    assert main(["ask", port, "altitude", "-5"]) == ExitCode.USAGE
    assert main(["ask", port, "dance"]) == ExitCode.USAGE
    assert main(["ask", "dance"]) == ExitCode.USAGE
    assert main(["ask", "tcp://0.0.0.0:1", "hold"]) == ExitCode.USAGE
    assert main(["ask", "1", "hold", "--timeout", "0.05"]) == ExitCode.NO_VEHICLE
    assert "is a flight running there" in capsys.readouterr().err


def test_the_result_of_a_reload_is_reported_to_its_client(served, client, capsys):
    port = served.endpoint.rpartition(":")[2]
    reading = ReloadReport()
    for good, code in ((True, ExitCode.DONE), (False, ExitCode.REFUSED)):
        read = ReloadReport(under_way=False, good=good, why=f"read, and {good}")
        served.readings = [reading, reading, read]
        assert main(["ask", port, "reload"]) == code
        verdict = "accepted" if good else "refused [not-reloaded]"
        assert capsys.readouterr().out == f"{verdict}: read, and {good}\n"
    served.readings = [reading, reading]
    answer = client.reload(wait_s=0.0)
    assert (answer.accepted, answer.why) == (True, reading.why)
    assert client.status()["reload"] == dataclasses.asdict(reading)


def test_a_server_that_is_no_flight_is_reported_as_such():
    with zmq.Context() as context, context.socket(zmq.ROUTER) as intruder:
        endpoint = bind(intruder, "tcp://127.0.0.1:*")

        def answer():
            for reply in (b"[]", b'{"ok":true}', b"\xff"):
                frames = intruder.recv_multipart()
                intruder.send_multipart([frames[0], reply])

        thread = threading.Thread(target=answer)
        thread.start()
        with ControlClient(endpoint) as client:
            for _ in range(3):
                with pytest.raises(ControlUnreachableError, match="is not a flight"):
                    client.hold()
        thread.join()
    with pytest.raises(ControlUnreachableError, match="is no endpoint"):
        ControlClient("nonsense")


@pytest.mark.parametrize("served", [CONTROL_NAME], indirect=True)
def test_what_the_docs_show_is_done(served, capsys):
    page = (Path(__file__).parents[3] / "docs" / "control.md").read_text(encoding="utf-8")
    snippet, _ = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    exec(compile(snippet, "docs/control.md", "exec"), {})  # noqa: S102
    assert capsys.readouterr().out.splitlines()[-1] == "GOTO"
    commands = re.findall(r"^    air-router (ask .*)$", page, re.MULTILINE)
    assert len(commands) == 3
    for command in commands:
        assert main(command.split()) == ExitCode.DONE
    request, reply = re.findall(
        r"^    (\{\"(?:request|ok)\".*?\})$", page, re.MULTILINE | re.DOTALL
    )
    with zmq.Context() as context, context.socket(zmq.REQ) as plain:
        plain.setsockopt(zmq.LINGER, 0)
        connect(plain, served.endpoint)
        plain.send_string(request)
        assert plain.poll(5000)
        assert json.loads(plain.recv()) == json.loads(reply)
    verbs = set(re.findall(r"`([a-z]+)`", page))
    assert set(MODELS) <= verbs


def test_requests_as_text_and_their_clients(pennovation):
    frame = pennovation.frame
    request = parse_command("goto 39.9415,-75.1990 39.9420,-75.1995").for_mission(frame)
    assert isinstance(request, GoTo)
    assert len(request.points) == 2
    command = command_request_of({"request": "hold", "by": "eve\x1b[2J\n"})
    assert command.for_mission(frame) == HoldNow(by="eve?[2J")
    assert (
        command_request_of({"request": "hold", "by": " "}).for_mission(frame, "a page").by
        == "a page"
    )
    assert parse_command("altitude 45").for_mission(frame) == ChangeAltitude(45.0)
    assert parse_command("status").for_mission(frame) is None


def test_a_budget_fills_up_to_what_may_be_spent_at_once():
    now_s = [0.0]
    budget = Budget(5.0, 10.0, lambda: now_s[0])
    now_s[0] = 3600.0
    assert [budget.spend() for _ in range(11)] == [True] * 10 + [False]
    now_s[0] += 0.25
    assert [budget.spend() for _ in range(2)] == [True, False]


def test_an_answer_to_another_request_of_the_same_number_is_not_taken_for_its_own(pretend):
    """Goals of a base station that wait are answered when a request ends the mission."""
    flight = pretend()
    flight.give(GoTo((Point(30.0, 0.0),), waits=True, by="base", request_id="1"))
    flight.give(flight.telemetry())
    service = CommandService(
        flight.mission.frame,
        flight.controller.status,
        lambda request: flight.controller.handle(request, flight.now_s),
    )
    answer = service.submit(ComeHome())
    assert (answer.by, answer.accepted) == ("the operator", True)
