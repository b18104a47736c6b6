"""A program forks beside its node: the child gets errors, never a hang, and holds no port."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from mocha_link.node.node import Node
from tests.mocha_link.conftest import Field, field  # noqa: F401 - a fixture

PROGRAM = Path(__file__).with_name("forking_planner.py")


def write_team(field: Field, path: Path) -> Path:  # noqa: F811 - the fixture's
    path.write_text(field.team.dump())
    return path


@pytest.mark.parametrize("stored", [False, True], ids=["in memory", "with storage"])
def test_children_of_a_program_with_a_node_get_errors_and_hold_nothing(field, tmp_path, stored):  # noqa: F811
    team = write_team(field, tmp_path / "team.yaml")
    storage = [str(tmp_path / "titan.db")] if stored else []
    done = subprocess.run(
        [sys.executable, "-W", "ignore::DeprecationWarning", str(PROGRAM), str(team), *storage],
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    seen = json.loads(done.stdout)
    assert seen["status"] == 0  # the child ended by itself
    assert "belongs to the process that made it" in seen["child"].pop("with")
    child = seen["child"]
    closes = {name: child.pop(name) for name in list(child) if name.endswith(".close")}
    assert len(closes) == 5
    assert set(closes.values()) == {"nothing"}  # nothing is open there
    assert {name for name in child if name.startswith("Node.")} > {"Node.publish", "Node.links"}
    assert {name: what for name, what in child.items() if what != "ForkedError"} == {}
    assert seen["before"] == ("last" if stored else None)
    assert seen["after"] == ("after the child's end" if stored else None)
    if stored:
        with Node(team, "titan", storage=storage[0]) as node:
            assert node.storage_fault is None
