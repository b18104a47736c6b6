"""A planner in plain ZeroMQ: requests, messages and links of a flight at one socket."""

import asyncio
import contextlib
import json
import os
import re
import threading
from pathlib import Path

import pytest
import zmq

from air_router.cli.cli import PROGRAM
from air_router.control import CONTROL_NAME
from air_router.control.command_request import MODELS, json_schema, parse_command
from air_router.control.control_server import MAX_MESSAGE_BYTES, ControlServer
from benchmarks.fleet.network_sim import team_of
from mocha_link import Node
from mocha_link.cli import options_of
from mocha_link.radios import ManualRadio
from tests.command_lines import context_of
from tests.mocha_link.conftest import DATA, field  # noqa: F401 - a fixture

DOCS = Path(__file__).parents[3] / "docs"
PAGE, SCHEMA = DOCS / "control.md", DOCS / "schemas" / "flight-request.json"


@pytest.fixture
def node(field):  # noqa: F811 - the fixture
    ports = field.team.robot("titan").base_port
    place = {"address": field.host, "listen": field.host}
    robots = {"one": {"base_port": ports, **place}, "two": {"base_port": ports + 1, **place}}
    team = team_of((DATA / "ros_team.yaml").read_text()).with_robots(robots)
    with Node(team, "one", clock=field.clock, radio=ManualRadio()) as node:
        yield node


@contextlib.contextmanager
def serving(node, carried_out):
    """The endpoint of a flight whose requests are only noted."""
    ready, stop, found = threading.Event(), [], []

    async def run():
        def execute(command, by):
            carried_out.append((command, by))
            return {"accepted": True, "why": "noted", "code": None, "state": "HOLD"}

        server = ControlServer("ipc://*", execute, node)
        server.open()
        found.append(server.endpoint)
        loop, over = asyncio.get_running_loop(), asyncio.Event()
        stop.append(lambda: loop.call_soon_threadsafe(over.set))
        task = asyncio.ensure_future(server.run())
        ready.set()
        await over.wait()
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task
        server.close()

    thread = threading.Thread(target=lambda: asyncio.run(run()))
    thread.start()
    assert ready.wait(60)
    try:
        yield found[0]
    finally:
        stop[0]()
        thread.join()


@pytest.fixture
def planner(node):
    """A plain REQ socket; `request` returns the answer and the frames behind it."""
    carried_out = []
    with (
        serving(node, carried_out) as endpoint,
        zmq.Context() as context,
        context.socket(zmq.REQ) as socket,
    ):
        socket.linger = 0
        socket.connect(endpoint)

        def request(*data, **values):
            socket.send_multipart([json.dumps(values).encode(), *data])
            assert socket.poll(60_000), "no answer"
            answer, *frames = socket.recv_multipart()
            return json.loads(answer), frames

        request.carried_out, request.endpoint = carried_out, endpoint
        yield request


def test_publish_latest_links_and_a_request_at_one_socket(planner, node):
    answer, _ = planner(b"here", request="publish", topic="/raw", id=1)
    assert (answer["ok"], answer["id"]) == (True, 1)
    answer, frames = planner(request="latest", robot="one", topic="/raw")
    assert (answer["message"]["header"], frames) == (
        str(node.latest("one", "/raw").header),
        [b"here"],
    )
    answer, _ = planner(request="links")
    assert (answer["robot"], set(answer["links"])) == ("one", {"two"})
    assert answer["links"]["two"]["state"] == "idle"
    answer, _ = planner(request="hold", by="a planner")
    assert (answer["ok"], answer["accepted"]) == (True, True)
    assert [command.request for command, _ in planner.carried_out] == ["hold"]


def test_the_planner_of_the_docs(planner, node, capsys):
    snippet = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)[1]
    snippet = snippet.replace("ipc:///tmp/uav", planner.endpoint).replace('"io"', '"two"')
    names = {}
    exec(compile(snippet, "docs/control.md", "exec"), names)  # noqa: S102
    names["uav"].close(0)
    names["uav"].context.term()
    assert capsys.readouterr().out.splitlines() == ["two idle None", "None", "noted"]


def test_a_planner_that_waits_for_a_message_gets_it_and_holds_up_no_request(planner, node):
    with zmq.Context() as context, context.socket(zmq.DEALER) as waiting:
        waiting.linger = 0
        waiting.connect(planner.endpoint)
        waiting.send_json({"request": "since", "wait_s": 60, "own": True, "id": 7})
        assert planner(request="hold")[0]["accepted"]  # is answered while the other waits
        assert not waiting.poll(0)
        node.publish("/raw", b"new", now=True)
        assert waiting.poll(60_000)
        answer, data = waiting.recv_multipart()
        assert ([m["topic"] for m in json.loads(answer)["messages"]], data) == (["/raw"], b"new")


def test_what_the_node_refuses_is_one_error_and_the_flight_goes_on(planner):
    too_large = {"request": "hold", "by": "x" * 70_000}
    for values, why in (
        ({"request": "publish", "topic": "/none"}, "/none"),
        ({"request": "latest", "robot": "nobody", "topic": "/raw"}, "nobody"),
        ({"request": "since", "limit": 0}, "limit"),
        (too_large, "65536 bytes"),
        ({"request": []}, "no request"),
        ({"request": {"publish": 1}}, "no request"),
        ({"request": "publish", "topic": "/raw", "value": "x" * 70_000}, "65536 bytes"),
    ):
        answer, _ = planner(**values)
        assert not answer["ok"]
        assert why in answer["error"]
    assert planner(request="hold")[0]["accepted"]


def test_a_message_as_large_as_allowed_is_published(planner, node):
    assert planner(bytes(MAX_MESSAGE_BYTES - 1000), request="publish", topic="/raw")[0]["ok"]
    assert len(node.latest("one", "/raw").data) == MAX_MESSAGE_BYTES - 1000


def test_the_schema_of_requests_is_current_and_names_every_verb():
    text = json.dumps(json_schema(), indent=1) + "\n"
    if os.environ.get("DOCS_WRITE"):
        SCHEMA.write_text(text, encoding="utf-8")
    assert SCHEMA.read_text(encoding="utf-8") == text, "write it anew: DOCS_WRITE=1 pytest ..."
    assert set(json_schema()["discriminator"]["mapping"]) == set(MODELS)


def test_every_request_as_text_is_one_of_the_union():
    typed = {"resume": "resume upload", "seek": "seek io", "goto": "goto 39.9,-75.1"}
    typed |= {"altitude": "altitude 45"}
    for verb, model in MODELS.items():
        assert type(parse_command(typed.get(verb, verb))) is model


@pytest.mark.parametrize("verb", ["fly", "sim"])
def test_control_alone_is_at_the_usual_endpoint(verb, monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    options = options_of(context_of(PROGRAM, [verb, "m.yaml", "--control"]))
    assert options.control == f"ipc://{tmp_path}/mocha-link/{CONTROL_NAME}"
