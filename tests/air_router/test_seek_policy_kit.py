"""The test kit for seek policies of other packages, and the template that they begin with."""

import os
import random
import re
import runpy
import subprocess
import sys
from dataclasses import replace

import pytest

from air_router.seek_policies import Freshest, Rendezvous, Tour, policy_of
from air_router.seek_policies.template import Nearest
from air_router.seek_policies.testing import SCENES, Scene, check
from tests.distributions import ROOT
from tests.docs.blocks import blocks


class InTurn:
    foresees = False

    def order(self, targets, context):
        return [self.place(name, targets, context) for name in targets.candidates(context.now_s)]

    def place(self, robot, targets, context):
        return targets.place(robot, context.now_s)


@pytest.mark.parametrize("scene", SCENES, ids=str)
@pytest.mark.parametrize("policy", [InTurn, Nearest, Freshest, Rendezvous, Tour])
def test_ours_keep_the_contract(policy, scene):
    assert {place.robot for place in check(policy, scene)} == set(scene.targets().names)


def test_round_robin_keeps_it_by_its_name():
    for scene in SCENES:
        check(lambda: policy_of("round_robin"), scene)


class Forgetful(InTurn):
    def order(self, targets, context):
        return super().order(targets, context)[1:]


class Restless(InTurn):
    def order(self, targets, context):
        return sorted(super().order(targets, context), key=lambda _: random.random())


class Counting(InTurn):
    calls = 0

    def order(self, targets, context):
        self.calls += 1
        found = super().order(targets, context)
        return [replace(place, reason=f"call {self.calls}") for place in found]


class Meddling(InTurn):
    def order(self, targets, context):
        for name in targets.names:
            targets.tracks[name].tried()
        return super().order(targets, context)


class Greedy(InTurn):
    def order(self, targets, context):
        return [self.place(name, targets, context) for name in sorted(targets.names, reverse=True)]


class Elsewhere(InTurn):
    def place(self, robot, targets, context):
        return targets.place(targets.names[0], context.now_s)

    def order(self, targets, context):
        return InTurn().order(targets, context)


class OverItself(InTurn):
    def place(self, robot, targets, context):
        return replace(super().place(robot, targets, context), over=(robot,))


class Vague(InTurn):
    foresees = None


@pytest.mark.parametrize(
    ("policy", "why"),
    [
        (Forgetful, "every robot once"),
        (Restless, "ranks the same robots otherwise"),
        (Counting, "keep nothing between calls"),
        (Meddling, "has changed targets"),
        (Greedy, "rank each group"),
        (Elsewhere, "returned the place of"),
        (OverItself, "the robot itself"),
        (Vague, "not True or False"),
        (object, "has no foresees"),
    ],
)
def test_what_breaks_the_contract_is_reported(policy, why):
    def all_scenes():
        for scene in SCENES:
            check(policy, scene)

    with pytest.raises(AssertionError, match=why):
        all_scenes()


SNIPPETS = [block.text for block in blocks() if block.name.startswith("seeking.md python")]


def test_the_docs_show_the_template():
    assert (
        SNIPPETS[0].strip() == (ROOT / "air_router/seek_policies/template.py").read_text().strip()
    )


def test_the_docs_show_the_kit(tmp_path):
    """As a stranger runs it: the printed policy, and the test beside it."""
    (tmp_path / "my_policy.py").write_text(SNIPPETS[0], encoding="utf-8")
    (tmp_path / "test_mine.py").write_text(SNIPPETS[1], encoding="utf-8")
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_mine.py"]
    path = f"{tmp_path}{os.pathsep}{ROOT}"
    environment = {**os.environ, "PYTHONPATH": path, "PYTEST_ADDOPTS": ""}
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, cwd=tmp_path, env=environment
    )
    assert f"{len(SCENES)} passed" in done.stdout, done.stdout + done.stderr


def test_the_docs_name_what_a_policy_may_see():
    """Each name of the table is one of a robot list, a robot's track, its course or the context."""
    scene = Scene("paths", paths=True)
    targets = scene.targets()
    seen = (targets, targets.tracks["robot01"], targets.course("robot01"), scene.context())
    text = (ROOT / "docs/seeking.md").read_text().partition("**Its input**")[2]
    table = text.partition("**It returns**")[0]
    rows = [line for line in table.splitlines() if line.startswith("| `")]
    spans = [span for line in rows for span in re.findall(r"`([^`]+)`", line)]
    names = {re.sub(r"[(\[].*", "", span).rpartition(".")[2] for span in spans}
    names -= {"None", "round_robin"}
    assert len(names) > 20
    assert [name for name in names if not any(hasattr(each, name) for each in seen)] == []


def test_the_template_is_printed_and_is_short(tmp_path):
    command = [sys.executable, "-m", "air_router.seek_policies"]
    printed = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT).stdout
    assert len([line for line in printed.splitlines() if line.strip()]) <= 20
    path = tmp_path / "my_policy.py"
    path.write_text(printed, encoding="utf-8")
    made = runpy.run_path(str(path))["Nearest"]
    scene = SCENES[3]
    ranked, context = check(made, scene), scene.context()
    flights_s = [context.flight_s(place.position) for place in ranked]
    assert flights_s == sorted(flights_s)
