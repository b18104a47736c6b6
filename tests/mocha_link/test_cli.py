"""The command: exit codes, clear errors, and a node in a process of its own."""

from __future__ import annotations

import contextlib
import json
import signal
import subprocess
import sys

import pytest

from mocha_link.cli import main
from mocha_link.metrics import Direction, SyncEnded
from mocha_link.telemetry import MetricsServer


@pytest.fixture
def team_file(field, tmp_path):
    path = tmp_path / "team.yaml"
    path.write_text(field.team.dump())
    return path


def test_check_shows_ids_and_ports(team_file, field, capsys):
    assert main(["check", str(team_file)]) == 0
    out = capsys.readouterr().out
    assert f"callisto:{field.team.robot('titan').port_for('callisto')}" in out
    assert "/slow" in out
    assert main(["check", "--json", str(team_file)]) == 0
    ids = json.loads(capsys.readouterr().out)
    assert ids["robots"]["titan"]["robot_id"] == 2
    assert ids["kinds"]["aerial_robot"]["/slow"]["dtype"] == 3


def test_an_invalid_file_is_3(team_file, capsys):
    team_file.write_text(team_file.read_text().replace("kind: ", "knd: ", 1))
    assert main(["check", str(team_file)]) == 3
    error = capsys.readouterr().err
    assert f"{team_file}:3:5: unknown key 'knd'; did you mean 'kind'?" in error
    assert main(["node", str(team_file.parent / "none.yaml"), "--robot", "io"]) == 3


def test_wrong_usage_is_2(team_file, capsys):
    assert main(["node", str(team_file), "--robot", "mars"]) == 2
    assert "no robot 'mars'" in capsys.readouterr().err
    for arguments in ([], ["fly"], ["node", str(team_file)], ["metrics", "x", "--timeout", "-1"]):
        with pytest.raises(SystemExit) as caught:
            main(arguments)
        assert caught.value.code == 2


def test_a_port_in_use_is_1(field, team_file, capsys):
    field.node("titan")
    assert main(["node", str(team_file), "--robot", "titan"]) == 1
    assert "is in use; end the other node" in capsys.readouterr().err


def test_metrics_of_a_node(field, capsys):
    node, _, _ = field.node("titan")
    with MetricsServer(node, f"tcp://{field.host}:*") as server:
        assert main(["metrics", server.endpoint]) == 0
        out = capsys.readouterr().out
        assert out.startswith("links of titan\npeer")
        assert "callisto  idle" in out
        assert main(["metrics", server.endpoint, "--json"]) == 0
        assert json.loads(capsys.readouterr().out)["links"]["io"]["state"] == "idle"
    assert main(["metrics", server.endpoint, "--timeout", "0.05"]) == 1
    assert "is a node running there" in capsys.readouterr().err


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 0)])
def test_a_node_in_its_own_process(field, team_file, number, code):
    titan, _, saw = field.node("titan")
    titan.publish("/map", b"grid")
    command = [sys.executable, "-m", "mocha_link.cli", "node", str(team_file), "--robot", "io"]
    command += ["--json", "--metrics", f"tcp://{field.host}:*"]
    with (
        subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        ) as process,
        contextlib.ExitStack() as stack,
    ):
        stack.callback(process.kill)  # whatever fails here; an ended process does not mind
        lines = []
        for line in process.stderr:
            lines.append(line)
            if line.startswith("ready"):
                break
        assert any(line.startswith("metrics on tcp://") for line in lines)
        # It has no radio, so the timer pulls.
        assert saw.wait(SyncEnded, peer="io", direction=Direction.OUT).messages == 1
        for line in process.stdout:
            event = json.loads(line)
            if event["event"] == "SyncEnded":
                assert event["peer"] == "titan"
                assert event["messages"] == 1
                break
        process.send_signal(number)
        process.communicate(timeout=20)
        assert process.returncode == code
