"""The command: exit codes, clear errors, and a node in a process of its own."""

import contextlib
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from mocha_link.cli import metrics_command
from mocha_link.cli.cli import main
from mocha_link.links.metrics import Direction, SyncEnded
from mocha_link.node.node import Node
from mocha_link.service.server import MetricsServer
from mocha_link.sync.send_round import PUSH_BYTES


@pytest.fixture
def team_file(field, tmp_path):
    path = tmp_path / "team.yaml"
    path.write_text(field.team.dump())
    return path


def test_check_gives_problems_to_scripts_too(capsys, tmp_path):
    path = tmp_path / "team.yaml"
    robot = "{kind: rover, address: 127.0.0.1, base_port: 65530, clients: [us]}"
    path.write_text(f"kinds: {{}}\nrobots: {{io: {robot}}}\n")
    assert main(["check", "--json", str(path)]) == 3
    out, err = capsys.readouterr()
    problems = json.loads(out)["problems"]
    assert [problem["code"] for problem in problems] == ["unknown-kind", "unknown-robot"]
    for problem, line in zip(problems, err.splitlines(), strict=True):
        where = f"{path}:{problem['line']}:{problem['column']}"
        assert line == f"{where}: {problem['message']} [{problem['code']}]"


def a_team(path, *, old="", topic="{name: /pose, type: json/A}", rest=""):
    path.write_text(f"""\
robots:
  a: {{kind: rover, address: 127.0.0.1, base_port: 10, clients: [old], radio: "stdin:"}}
  old: {{kind: rover, address: 127.0.0.2, base_port: 10, clients: [a]{old}}}
kinds: {{rover: {{topics: [{topic}]}}}}
{rest}
""")
    return str(path)


def test_check_shows_what_the_team_requests(tmp_path, capsys):
    path = tmp_path / "team.yaml"
    assert main(["check", a_team(path)]) == 0
    out = capsys.readouterr().out
    assert "pulls every 2 s; with a radio from a signal of -75 dBm, 10 dB SNR or 20 device" in out
    assert "; trust: relays" in out
    topic = "{name: /log, type: json/B, history: 3, min_interval_s: 5, aggregate: true}"
    rest = "trigger: {budget_bytes: 5000}\ntrust: signed"
    assert main(["check", a_team(path, topic=topic, rest=rest)]) == 0
    out = capsys.readouterr().out
    assert "5 s            3      all together" in out
    assert "; at most 5000 bytes in a contact; trust: signed" in out
    assert main(["check", "--json", a_team(path, old=", original: true", rest=rest)]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert shown["robots"]["old"]["original"] is True
    assert shown["kinds"]["rover"]["/pose"]["history"] == 1
    assert shown["trigger"]["budget_bytes"] == 5000
    assert shown["trust"] == "signed"


@pytest.mark.parametrize("wrong", ["24500", "127.0.0.1:24500", "tcp://127.0.0.1", "ipc://", "x"])
def test_what_is_no_endpoint_is_2(team_file, capsys, wrong):
    for arguments in (
        ["node", str(team_file), "--robot", "io", "--metrics", wrong],
        ["node", str(team_file), "--robot", "io", "--serve", wrong],
        ["metrics", wrong],
        ["monitor", wrong],
        ["bridge", "ros2", "--node", wrong],
    ):
        assert main(arguments) == 2
        assert f"'{wrong}' is no endpoint; write tcp://127.0.0.1:24500" in capsys.readouterr().err


@pytest.mark.parametrize("wrong", ["", "here", "127.0.0.1", "a:b", ":-1", ":65536"])
def test_what_is_no_web_address_is_2(team_file, capsys, wrong):
    assert main(["node", str(team_file), "--robot", "io", f"--prometheus={wrong}"]) == 2
    assert f"'{wrong}' is no address; write host:port" in capsys.readouterr().err


def test_an_invalid_file_is_3(team_file, capsys):
    team_file.write_text(team_file.read_text().replace("kind: ", "knd: ", 1))
    assert main(["check", str(team_file)]) == 3
    error = capsys.readouterr().err
    assert f"{team_file}:3:5: unknown key 'knd'; did you mean 'kind'?" in error
    assert main(["node", str(team_file.parent / "none.yaml"), "--robot", "io"]) == 3


def test_wrong_usage_is_2(team_file, capsys):
    assert main(["node", str(team_file), "--robot", "mars"]) == 2
    assert "no robot 'mars'" in capsys.readouterr().err
    for arguments in ([], ["fly"], ["node", str(team_file)]):
        assert main(arguments) == 2
    capsys.readouterr()
    for timeout in ("-1", "nan", "soon"):
        for arguments in (
            ["metrics", "tcp://x:1", "--timeout", timeout],
            ["doctor", str(team_file), "--robot", "io", "--seconds", timeout],
        ):
            assert main(arguments) == 2
            assert f"'{timeout}' is no time; write seconds" in capsys.readouterr().err
    assert main(["keys", str(team_file), "--out", "x" * 300]) == 1
    assert capsys.readouterr().err.endswith("titan.key: File name too long\n")


def test_a_port_in_use_is_1(field, team_file, capsys):
    field.node("titan")
    assert main(["node", str(team_file), "--robot", "titan"]) == 1
    assert "is in use; end the other node" in capsys.readouterr().err


def test_metrics_of_a_node(field, capsys):
    node, _, _ = field.node("titan")
    with MetricsServer(node, f"tcp://{field.host}:*") as server:
        assert main(["metrics", server.endpoint]) == 0
        out = capsys.readouterr().out
        assert out.startswith(f"links of titan, {server.endpoint}\npeer")
        assert "callisto  idle" in out
        assert main(["metrics", server.endpoint, "--json"]) == 0
        assert json.loads(capsys.readouterr().out)["links"]["io"]["state"] == "idle"
    assert main(["metrics", server.endpoint, "--timeout", "0.05"]) == 1
    assert "is a node running there" in capsys.readouterr().err


SNAPSHOT = {"robot": "io", "at_s": 1_795_175_902.5, "links": {}}


def test_metrics_are_followed_line_by_line(field, capsys, monkeypatch):
    snapshot = SNAPSHOT
    event = {"event": "RssiChanged", "peer": "io", "at_s": 1_795_175_900.25, "rssi_dbm": -61.0}
    nothing = {**event, "event": "SyncEnded", "direction": "in", "messages": 0}
    del nothing["rssi_dbm"]
    updates = [
        ("links", snapshot),
        *(("event", each) for each in (event, nothing, nothing)),  # a repetition is no update
        ("links", snapshot),
    ]
    monkeypatch.setattr(metrics_command, "watch", lambda *_, **__: iter(updates))
    assert main(["metrics", "tcp://x:1", "--follow"]) == 0
    title, heads, *lines = capsys.readouterr().out.splitlines()
    assert title == "links of io, tcp://x:1"
    assert heads.startswith("peer  state  path  signal")
    assert lines == [
        "2026-11-20T11:58:20.250Z RssiChanged io rssi_dbm=-61.000",
        "2026-11-20T11:58:20.250Z SyncEnded io direction=in messages=0",
    ]
    assert main(["metrics", "tcp://x:1", "--follow", "--json"]) == 0
    assert [json.loads(line) for line in capsys.readouterr().out.splitlines()] == [
        fields for _, fields in updates
    ]


@pytest.mark.parametrize(
    ("kind", "fields"),
    [
        ("links", {}),
        ("links", {"robot": "io", "at_s": 5, "links": []}),
        ("links", {"robot": "io", "at_s": None, "links": {"a": 3}}),
        ("event", {"event": "SyncEnded"}),
        ("event", {"event": "SyncEnded", "peer": "io", "at_s": 1e300}),
    ],
)
@pytest.mark.parametrize("options", [[], ["--json"]])
def test_metrics_that_are_none(capsys, monkeypatch, kind, fields, options):
    monkeypatch.setattr(metrics_command, "watch", lambda *_, **__: iter([(kind, fields)]))
    assert main(["metrics", "tcp://x:1", "--follow", *options]) == 1
    assert "what tcp://x:1 sends is not a node's metrics" in capsys.readouterr().err


@pytest.fixture
def ctrl_c():
    """Lets child processes see SIGINT also when the tests run in the background of a script."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def started(command, **options) -> tuple[subprocess.Popen, list[str]]:
    """A node in a process of its own that is ready, and what it printed until then."""
    process = subprocess.Popen(
        [sys.executable, "-m", "mocha_link.cli.cli", "node", *command],
        stderr=subprocess.PIPE,
        text=True,
        **options,
    )
    lines = []
    for line in process.stderr:
        lines.append(line)
        if line.startswith("ready"):
            break
    return process, lines


def test_a_node_needs_no_reader_of_its_events(field, team_file):
    """Neither one that does not read, nor one that has gone."""
    titan, _, saw = field.node("titan")

    def pulled():
        titan.publish("/map", os.urandom(2 * PUSH_BYTES))  # so large that it is pulled
        while not saw.wait(SyncEnded, peer="io", direction=Direction.OUT).messages:
            pass

    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    with contextlib.suppress(BlockingIOError):
        while True:
            os.write(writer, bytes(4096))  # full before the first event
    os.set_blocking(writer, True)
    process, _ = started([str(team_file), "--robot", "io"], stdout=writer)
    os.close(writer)
    with process:
        pulled()
        os.close(reader)
        assert any("no event is printed any more (Broken pipe)" in line for line in process.stderr)
        pulled()
        process.terminate()
        assert process.stderr.read() == ""
    assert process.returncode == 0


def test_a_node_goes_on_when_the_disk_with_its_output_is_full(field, team_file):
    _, _, saw = field.node("titan")
    with Path("/dev/full").open("w") as full:
        process, _ = started([str(team_file), "--robot", "io"], stdout=full)
    with process:
        assert any("No space left on device" in line for line in process.stderr)
        saw.wait(SyncEnded, peer="io", direction=Direction.OUT)
        process.terminate()
    assert process.returncode == 0


@pytest.mark.usefixtures("ctrl_c")
def test_a_node_in_its_own_process(field, team_file):
    titan, _, saw = field.node("titan")
    titan.publish("/map", b"grid")
    command = [str(team_file), "--robot", "io", "--json", "--metrics", f"tcp://{field.host}:*"]
    process, lines = started(command, stdout=subprocess.PIPE)
    with process, contextlib.ExitStack() as stack:
        stack.callback(process.kill)  # whatever fails here; an ended process does not mind
        assert any(line.startswith("metrics on tcp://") for line in lines)
        # It has no radio, so the timer pulls.
        assert saw.wait(SyncEnded, peer="io", direction=Direction.OUT).messages == 1
        for line in process.stdout:
            event = json.loads(line)
            if event["event"] == "SyncEnded":
                assert event["peer"] == "titan"
                assert event["messages"] == 1
                break
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=60)
        assert process.returncode == 130


def test_a_node_prints_what_is_stored_and_whom_it_stands_in_for(tmp_path, field, team_file):
    storage = tmp_path / "io.db"
    with Node(field.team, "io", storage=storage) as node:
        node.publish("/pose", b"{}")
    team_file.write_text(field.team.with_robots({"io": {"original": True}}).dump())
    command = [str(team_file), "--robot", "io", "--storage", str(storage)]
    process, lines = started(command, stdout=subprocess.DEVNULL)
    with process:
        process.terminate()
    assert process.returncode == 0
    assert f"{storage} has 1 message\n" in lines
    assert any("has io as an original node" in line for line in lines)


@pytest.mark.parametrize("listen", ["*", "127.0.0.1"])
def test_a_node_without_keys_warns_if_other_machines_can_reach_it(field, team_file, listen):
    changes = {name: {"listen": listen, "address": "127.0.0.1"} for name in field.team.robots}
    team_file.write_text(field.team.with_robots(changes).dump())
    process, lines = started([str(team_file), "--robot", "io"], stdout=subprocess.DEVNULL)
    with process:
        process.terminate()
    warnings = [line for line in lines if "NO KEYS" in line]
    assert len(warnings) == (listen == "*")
    assert all("io on every interface, port" in line for line in warnings)
