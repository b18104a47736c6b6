"""Experiments need neither MAVSDK nor pymavlink: a run, its policies and its results."""

import json
import subprocess
import sys

from tests.distributions import ROOT, project

HIDDEN = """
import json, runpy, sys
from pathlib import Path

class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {"mavsdk", "pymavlink", "networkx", "matplotlib"}:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Absent())
from sitl.cli.cli import main
code = main(["experiment", sys.argv[1], "--out", sys.argv[2], "--jobs", "1", "--no-figures"])
json.dump([code, sorted({name.partition(".")[0] for name in sys.modules})], sys.stderr)
"""

PLAN = """
name: light
title: Towns and missions
seeds: 1
rows:
  - {label: town, town: urban, duration_s: 60, policy: tour}
  - {label: mission, world: mission, mission: pennovation}
"""


def test_experiments_run_without_what_flies(tmp_path):
    """Here and in the worker, which imports the same."""
    plan, code = tmp_path / "light.yaml", tmp_path / "light.py"
    plan.write_text(PLAN, encoding="utf-8")
    code.write_text(f"if __name__ in ('__main__', '__mp_main__'):{_indented(HIDDEN)}")
    command = [sys.executable, str(code), str(plan), str(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
    records = (tmp_path / "out" / "runs.jsonl").read_text().splitlines()
    assert {json.loads(record)["row"] for record in records} == {"town", "mission"}, done.stderr
    exit_code, loaded = json.loads(done.stderr.splitlines()[-1])
    assert exit_code == 0
    assert {"mavsdk", "pymavlink", "networkx", "matplotlib"}.isdisjoint(loaded)


def _indented(text):
    guarded = text.replace("code = main", "if __name__ == '__main__':\n    code = main")
    guarded = guarded.replace("json.dump", "    json.dump")
    return "".join(f"\n    {line}" for line in guarded.splitlines()) + "\n"


def test_the_core_and_the_extra_bring_neither():
    about = project(ROOT)
    needed = [*about["dependencies"], *about["optional-dependencies"]["experiments"]]
    assert not [each for each in needed if each.startswith(("mavsdk", "pymavlink"))]
    for extra in ("fly", "sim"):
        assert any(each.startswith("mavsdk") for each in about["optional-dependencies"][extra])
