"""What docs/ros.md shows can be done as it stands there."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("rosbags", reason="ROS messages need the extra 'ros'")

from mocha_link.ros.typed import Typed
from mocha_link.service.service import Service, ServiceServer

PAGE = (Path(__file__).parents[3] / "docs" / "ros.md").read_text()
PROGRAM, VALUES = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)


def test_the_program(one, tmp_path):
    with ServiceServer(one, f"ipc://{tmp_path}/io") as server:
        program = PROGRAM.replace("ipc:///tmp/io.node", server.endpoint)
        command = [sys.executable, "-u", "-c", program]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            assert "'ok': True" in next(process.stdout)
            assert next(process.stdout) == "one /goal {'go': 'home'}\n"
            one.publish("/goal", b"2")
            assert next(process.stdout) == "one /goal 2\n"
            process.kill()


def test_every_field_of_a_request_is_documented(one):
    rows = dict(re.findall(r"^\| `(\w+)` \| (.*)\|$", PAGE, re.MULTILINE))
    for name, verb in Service(one).verbs.items():
        for field, about in verb.model.model_fields.items():
            known = f"`{about.alias or field}`" in rows[name]
            assert known or field in {"request", "id"}, (name, field)


def test_values(one, pulled, team):
    types = Typed(team)
    program = VALUES.replace('"/goal"', '"/pose"')
    pulled("/pose", types.encode("two", "/pose", {"pose": {"position": {"x": 1.5}}}))
    places = {"team": team, "node": one}
    exec(program.replace('"io"', '"two"'), places)  # noqa: S102 - our own documentation
    assert places["pose"].pose.position.x == 1.5
    assert types.decode(one.latest("one", "/pose")).pose.position.x == 4.5
