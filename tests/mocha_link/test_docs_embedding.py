"""What docs/embedding.md and docs/team-file.md show works as it stands, and is complete."""

import contextlib
import dataclasses
import json
import re
import subprocess
import sys
import typing
from pathlib import Path

import pytest

from benchmarks.fleet.network_sim import team_of
from mocha_link import (
    Contact,
    LinkEvent,
    LinkMetrics,
    LinkState,
    MetricsServer,
    Node,
    Reading,
    Team,
    Unit,
    open_radio,
)
from mocha_link.errors import RadioError
from mocha_link.links.metrics import Direction
from mocha_link.radios.reports import parse_report
from mocha_link.service.service import ServiceServer
from mocha_link.team.document import Document
from mocha_link.team.team import Trigger
from mocha_link.team.team_file import FORMS, RobotModel, TopicModel

DOCS = Path(__file__).parents[2] / "docs"
EMBEDDING = (DOCS / "embedding.md").read_text()
PLANNER, READER, MODEM = re.findall(r"```python\n(.*?)```", EMBEDDING, re.DOTALL)
WAIT_S = 60
PLANNERS = """
robots:
  titan: {kind: robot, address: 127.0.0.1, base_port: 10, clients: [callisto, io]}
  callisto: {kind: robot, address: 127.0.0.1, base_port: 20, clients: [io, titan]}
  io: {kind: robot, address: 127.0.0.1, base_port: 30, clients: [callisto, titan]}
kinds:
  robot: {topics: [{name: /pose, type: json/Pose}, {name: /goal, type: json/Goal}]}
trigger: {interval_s: 0.2}
"""


def rows(text):
    """The cells of every table row."""
    return [line.strip("|").split("|") for line in text.splitlines() if line.startswith("|")]


def test_the_planner_meets_everybody(field_of, tmp_path):
    assert len([line for line in PLANNER.splitlines() if line.strip()]) <= 30
    field = field_of(PLANNERS)
    path = tmp_path / "team.yaml"
    path.write_text(field.team.dump())
    with contextlib.ExitStack() as stack:
        for name in ("callisto", "io"):  # no radio: all of them pull by the timer
            node = stack.enter_context(Node(field.team, name))
            node.publish("/pose", b'{"x": 1}')
        planner = subprocess.run(
            [sys.executable, "-c", PLANNER, str(path), "titan"],
            capture_output=True,
            text=True,
            timeout=WAIT_S,
            check=True,
        )
    *met, callisto, io = planner.stdout.splitlines()  # both may be met before it looks
    for line in met:
        assert re.fullmatch(r"synced with (callisto|io); seek (callisto|io), signal None", line)
    assert callisto == "callisto: {'x': 1}"
    assert io == "io: {'x': 1}"


def test_the_planner_of_another_language_needs_nothing_of_ours(field_of, tmp_path):
    assert "mocha_link" not in READER
    field = field_of(PLANNERS)
    node, radio, _ = field.node("titan")
    with (
        MetricsServer(node, f"ipc://{tmp_path}/metrics") as metrics,
        ServiceServer(node, f"ipc://{tmp_path}/node") as service,
        subprocess.Popen(
            [sys.executable, "-c", READER, metrics.endpoint, service.endpoint],
            stdout=subprocess.PIPE,
            text=True,
        ) as planner,
        contextlib.ExitStack() as stack,
    ):
        stack.callback(planner.kill)
        lines = iter(planner.stdout.readline, "")
        assert next(lines) == "seek callisto, signal None, None\n"
        assert json.loads(node.latest("titan", "/goal").data) == {"seek": "callisto"}
        strong = Reading(-60.0, Unit.DBM, "wifi")
        for name in ("callisto", "io"):
            peer, radio_of_peer, _ = field.node(name)
            peer.publish("/pose", json.dumps({"of": name}).encode())
            radio.report(name, strong)
            radio_of_peer.report("titan", strong)
        assert any(re.fullmatch(r"[\d.]+ RssiChanged io\n", line) for line in lines)
        signal = "{'value': -60.0, 'unit': 'dBm', 'source': 'wifi'}"
        # both were met at the same time of a clock that stands
        assert f"seek callisto, signal {signal}, {{'of': 'callisto'}}\n" in lines


def test_every_event_is_documented_with_its_fields():
    documented = {
        re.sub(r"[`\s]", "", cells[0]): set(re.findall(r"`(\w+)`", cells[2]))
        for cells in rows(EMBEDDING)
        if len(cells) == 3
    }
    for event in typing.get_args(LinkEvent):
        fields = {part.name for part in dataclasses.fields(event)} - {"peer", "at_s"}
        assert documented[event.__name__] == fields


def test_every_metric_is_documented():
    documented = set(re.findall(r"`([\w_]+)`", EMBEDDING))
    for kind in (LinkMetrics, Contact, Reading):
        assert {part.name for part in dataclasses.fields(kind)} <= documented
    for state in LinkState:
        assert state.value in documented
    assert {direction.value for direction in Direction} <= documented


def test_every_radio_and_unit_is_documented():
    urls = {re.sub(r"[`\s]", "", cells[0]) for cells in rows(EMBEDDING)}
    schemes = {url.partition(":")[0] for url in urls}
    assert set(FORMS) | {unit.value for unit in Unit} <= schemes
    trigger = Trigger()
    for name in ("rssi_threshold_dbm", "snr_threshold_db", "device_threshold", "hysteresis_db"):
        assert f"`{name}` ({getattr(trigger, name):g})" in EMBEDDING


def test_the_radio_of_a_program(field, tmp_path):
    path = tmp_path / "team.yaml"
    path.write_text(field.team.dump())
    with Node(Team.load(path), "io") as node:
        node.publish("/pose", b"{}")
        ended = subprocess.run(
            [sys.executable, "-c", MODEM, str(path), "titan", "io"],
            capture_output=True,
            text=True,
            timeout=WAIT_S,
            check=True,
        )
    assert re.fullmatch(r"(in|out) io -60 dBm \(modem\)\n", ended.stdout)
    assert not ended.stderr


@pytest.mark.parametrize("unit", ["dBm", None])
def test_a_unit_that_is_none(unit):
    with pytest.raises(RadioError, match="the unit of a reading must be a Unit, not"):
        Reading(-60.0, unit, "modem")


def test_the_reports_are_reports():
    (block,) = re.findall(r"```text\n(.*?)```", EMBEDDING, re.DOTALL)
    found = [parse_report(line.encode()) for line in block.splitlines()]
    assert found[:4] == [
        ("titan", Reading(-61.5, Unit.DBM, "radio")),
        ("titan", Reading(14.0, Unit.SNR_DB, "silvus")),
        ("titan", Reading(31.0, Unit.DEVICE, "radio")),
        ("titan", None),
    ]
    assert [reading and reading.value for _, reading in found[4:]] == [-61.5, 14.0, 31.0, None]


def test_the_team_has_radios():
    (text,) = re.findall(r"```yaml\n(.*?)```", EMBEDDING, re.DOTALL)
    team = Team.from_document(Document.from_text(text, Path("team.yaml")))
    for robot in team.robots.values():
        open_radio(robot.radio, team, robot.name)
    for url in re.findall(r'radio: "(.*?)"', EMBEDDING):
        assert open_radio(url, team, "io")


@pytest.mark.parametrize("model", [RobotModel, TopicModel, Trigger])
def test_every_key_is_documented_with_its_default(model):
    text = (DOCS / "team-file.md").read_text()
    rows = dict(re.findall(r"^\| `(\w+)` \| (.+?) \|", text, re.MULTILINE))
    for name, field in model.model_fields.items():
        if field.is_required():
            assert rows[name] == "required"
        elif field.default is None:
            assert rows[name] == "none"
        else:
            shown = rows[name].strip('`"')
            default = getattr(field.default, "name", field.default)  # of an enumeration
            assert shown == str(default).lower() or float(shown) == default


def test_the_examples_are_teams():
    text = (DOCS / "team-file.md").read_text()
    team, two_nodes = (
        team_of(example) for example in re.findall(r"```yaml\n(.*?)```", text, re.DOTALL)
    )
    assert team.robot("titan").port_for("io") == 24400
    assert two_nodes.robot("a").peers == ("b",)
    assert two_nodes.dump() == Team.load(DOCS.parent / "missions" / "two" / "team.yaml").dump()
