"""`mocha-link doctor`: what it finds with real nodes, and how it reports it."""

import json
import socket
import time
from types import SimpleNamespace

import pytest
import yaml

from benchmarks.fleet.network_sim import team_of
from mocha_link.cli import doctor_command
from mocha_link.cli.cli import main
from mocha_link.node.node import Node
from mocha_link.radios import ManualRadio
from tests.mocha_link.conftest import TEAM

PAIR = """\
robots:
  io: {kind: rover, address: 127.0.0.1, base_port: 10, clients: [titan]}
  titan: {kind: rover, address: 127.0.0.1, base_port: 20, clients: [io]}
kinds:
  rover: {topics: [{name: /pose, type: json/Pose}]}
"""
LONG_S, SHORT_S = 60.0, 0.5  # it ends as soon as all is well


def texts(findings, *, good):
    return [each.text for each in findings if each.good is good]


@pytest.fixture
def pair(field_of):
    return field_of(PAIR)


def test_two_that_talk(pair):
    with Node(pair.team, "titan"):
        findings = doctor_command.diagnose(pair.team, "io", seconds=LONG_S)
    assert texts(findings, good=False) == []
    here, outgoing, incoming = texts(findings, good=True)
    assert here == f"listens on {pair.host}: {pair.team.robot('io').port_for('titan')}"
    port = pair.team.robot("titan").base_port
    assert outgoing.startswith(f"a node answers at {pair.host}:{port}")
    assert incoming == f"it pulls from this robot, at port {pair.team.robot('io').base_port}"


def test_no_node_there(pair):
    findings = doctor_command.diagnose(pair.team, "io", seconds=SHORT_S)
    refused, silent = texts(findings, good=False)
    assert "Connection refused" in refused
    assert "no node of titan listens at that port" in refused
    assert f"another address than {pair.host}, port {pair.team.robot('io').base_port}" in silent


def test_who_takes_connections_and_sends_nothing(pair):
    titan = pair.team.robot("titan")
    with socket.create_server((pair.host, titan.base_port)):
        findings = doctor_command.diagnose(pair.team, "io", seconds=SHORT_S)
    assert "something takes connections there that is no node of titan" in findings[1].text


def test_beside_the_node_of_the_robot(pair):
    with Node(pair.team, "io"), Node(pair.team, "titan"):
        findings = doctor_command.diagnose(pair.team, "io", seconds=LONG_S)
    assert texts(findings, good=False) == []
    here, outgoing = texts(findings, good=True)
    assert here.startswith("the ports of io are taken, by its node no doubt")
    assert outgoing.startswith("a node answers at")


def test_a_radio_that_the_node_reads_is_no_fault(field_of):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        url = f"udp://127.0.0.1:{free.getsockname()[1]}"
    field = field_of(PAIR.replace("clients: [titan]", f'clients: [titan], radio: "{url}"'))
    with Node(field.team, "io"), Node(field.team, "titan"):
        findings = doctor_command.diagnose(field.team, "io", seconds=LONG_S)
    assert texts(findings, good=False) == []
    assert "its node reads the radio" in findings[1].text
    assert len(findings) == 3


def test_another_team_file(pair, field_of):
    document = yaml.safe_load(PAIR)
    document["kinds"]["rover"]["topics"].append({"name": "/map", "type": "a/B"})
    other = team_of(yaml.safe_dump(document))
    keys = {"base_port", "address", "listen"}
    places = {
        name: {key: getattr(robot, key) for key in keys} for name, robot in pair.team.robots.items()
    }
    with Node(other.with_robots(places), "titan"):
        findings = doctor_command.diagnose(pair.team, "io", seconds=SHORT_S)
    (differs,) = [each for each in findings if "titan has another team file" in each.text]
    assert not differs.good


def test_a_clock_ahead(pair):
    ahead = SimpleNamespace(now_s=lambda: time.time() + 600.0)
    with Node(pair.team, "titan", clock=ahead) as titan:
        titan.publish("/pose", b"{}")
        findings = doctor_command.diagnose(pair.team, "io", seconds=LONG_S)
    (clock,) = texts(findings, good=False)
    ahead_s = int(clock.removeprefix("its clock is ").split()[0])
    assert 500 < ahead_s <= 600


@pytest.mark.parametrize(
    ("readings", "text", "good"),
    [
        ({}, "does not receive it (it reports nothing at all)", False),
        ({"callisto": -50.0}, "does not receive it (it reports of others)", False),
        ({"io": -90.0}, "receives it at -90 dBm; too weak: no contact begins below -70", False),
        ({"io": -60.0}, "receives it at -60 dBm; a contact begins at -70", True),
    ],
)
def test_the_radio(field_of, monkeypatch, readings, text, good):
    document = yaml.safe_load(TEAM)
    document["robots"]["titan"]["radio"] = "udp://127.0.0.1:1"
    document["trigger"]["rssi_threshold_dbm"] = -70
    field = field_of(yaml.safe_dump(document))

    class Reporting(ManualRadio):
        def start(self, report):
            for peer, reading in readings.items():
                report(peer, reading)

    monkeypatch.setattr(doctor_command, "open_radio", lambda *_: Reporting())
    findings = doctor_command.diagnose(field.team, "titan", seconds=SHORT_S)
    (signal,) = (each for each in findings if each.peer == "io" and "the radio" in each.text)
    assert text in signal.text
    assert signal.good is good


def test_the_page(monkeypatch, tmp_path, capsys):
    path = tmp_path / "team.yaml"
    path.write_text(PAIR)
    found = [
        doctor_command.Finding(None, True, "listens"),
        doctor_command.Finding("titan", False, "no answer"),
    ]
    monkeypatch.setattr(doctor_command, "diagnose", lambda *_, **__: found)
    assert main(["doctor", str(path), "--robot", "io"]) == 1
    assert capsys.readouterr().out == "io, here\n  ok   listens\ntitan\n  BAD  no answer\n"
    assert main(["doctor", str(path), "--robot", "io", "--json"]) == 1
    output = SimpleNamespace(**json.loads(capsys.readouterr().out))
    assert (output.good, output.findings[1]["peer"]) == (False, "titan")
    del found[1]
    assert main(["doctor", str(path), "--robot", "io", "--json"]) == 0
    capsys.readouterr()
    monkeypatch.undo()
    assert main(["doctor", str(path), "--robot", "europa"]) == 2
    assert "europa" in capsys.readouterr().err
