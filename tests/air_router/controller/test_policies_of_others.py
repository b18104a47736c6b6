"""Seek policies of other packages: found by entry point or by class, guarded in flight."""

import os
import subprocess
import sys
import textwrap

import pytest

from air_router.cli.cli import main
from air_router.controller.targets import TargetList
from air_router.errors import ExitCode
from air_router.seek_policies import Point, SearchPlace, SeekPolicyError, policy_of
from tests.air_router.controller.test_seeking import context as context_at
from tests.distributions import ROOT

MISSION = ROOT / "missions" / "pennovation" / "mission.yaml"


def targets():
    return TargetList(("callisto", "europa", "io"))


def context():
    return context_at(100.0)


class Backwards:
    """Robots in the order opposite to the mission's."""

    foresees = False

    def order(self, targets, context):
        return [self.place(robot, targets, context) for robot in reversed(targets.names)]

    def place(self, robot, targets, context):
        return targets.place(robot, context.now_s)


class Raises(Backwards):
    def order(self, targets, context):
        raise ZeroDivisionError("no robots\x1b[2J")


class Forgets(Backwards):
    def order(self, targets, context):
        return super().order(targets, context)[1:]


class Nowhere(Backwards):
    def place(self, robot, targets, context):
        return SearchPlace(robot, Point(float("nan"), 0.0), "somewhere")


class OverAnother(Backwards):
    def place(self, robot, targets, context):
        return SearchPlace(robot, Point(1.0, 2.0), "there", over=("phantom",))


class NoPoint(Backwards):
    def place(self, robot, targets, context):
        return SearchPlace(robot, (1.0, 2.0), "there")


class NeedsMore(Backwards):
    def __init__(self, weight):
        self.weight = weight


HERE = __name__


def named(name):
    return policy_of(f"{HERE}:{name}")


def test_a_class_by_its_name_ranks_the_robots():
    robots = targets()
    ranked = [place.robot for place in named("Backwards").order(robots, context())]
    assert ranked == list(reversed(robots.names))


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("Raises", "ZeroDivisionError: no robots"),
        ("Forgets", "order() does not return every robot once"),
        ("Nowhere", "is no finite Point"),
        ("OverAnother", "is over robots that are not sought"),
        ("NoPoint", "is no finite Point"),
    ],
)
def test_one_that_fails_leaves_the_seeking_to_round_robin_and_the_reason_is_announced(name, why):
    robots, policy = targets(), named(name)
    spare = policy_of("round_robin")
    for _ in range(2):
        places = list(policy.order(robots, context()))
        expected = [place.robot for place in spare.order(robots, context())]
        assert [place.robot for place in places] == expected
        assert why in places[0].reason
        assert "\x1b" not in places[0].reason
    assert (
        policy.place("io", robots, context()).position
        == spare.place("io", robots, context()).position
    )


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("no_such_package:Policy", "cannot be loaded: ModuleNotFoundError"),
        (f"{HERE}:NoSuchClass", "cannot be loaded: AttributeError"),
        (f"{HERE}:NeedsMore", "cannot be made: TypeError"),
        (f"{HERE}:HERE", "is no seek policy"),
        ("nonesuch", "no seek policy is called 'nonesuch'"),
    ],
)
def test_what_cannot_be_loaded_is_one_clear_error(name, why):
    with pytest.raises(SeekPolicyError, match=why) as refused:
        policy_of(name)
    assert refused.value.exit_code == ExitCode.INVALID_FILE


def test_a_mission_file_with_an_unknown_policy_names_those_that_are(tmp_path, capsys):
    text = MISSION.read_text(encoding="utf-8")
    (tmp_path / "mission.yaml").write_text(
        text.replace("\nseek:", "\nseek: freshst\n#", 1), encoding="utf-8"
    )
    assert main(["check", str(tmp_path / "mission.yaml")]) == ExitCode.INVALID_FILE
    printed = capsys.readouterr().err
    assert "freshest" in printed
    assert "[unknown-word]" in printed


STRANGER = '''
"""A policy of another package."""
from air_router.seek_policies import SearchPlace, SeekContext, TargetList

class Nearest:
    foresees = False

    def order(self, targets: TargetList, context: SeekContext) -> list[SearchPlace]:
        names = targets.candidates(context.now_s)
        places = [self.place(name, targets, context) for name in names]
        return sorted(places, key=lambda each: context.flight_s(each.position or context.unseen))

    def place(self, robot: str, targets: TargetList, context: SeekContext) -> SearchPlace:
        return targets.place(robot, context.now_s)
'''


def test_a_package_with_an_entry_point_is_found_by_its_name(tmp_path):
    """As pip installs it: the module, and a .dist-info with its entry point."""
    (tmp_path / "acme_seek.py").write_text(STRANGER, encoding="utf-8")
    info = tmp_path / "acme_seek-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: acme-seek\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        "[air_router.seek_policies]\nnearest = acme_seek:Nearest\n"
        "tour = zoo:Nothing\nbroken = acme_seek:Nothing\n"
    )
    text = MISSION.read_text(encoding="utf-8").replace("\nseek:", "\nseek: nearest\n#", 1)
    mission = tmp_path / "mission.yaml"
    for name in ("team.yaml", "world.yaml", "town.yaml"):
        (tmp_path / name).write_bytes((MISSION.parent / name).read_bytes())
    mission.write_text(text, encoding="utf-8")

    def run(*arguments):
        program = textwrap.dedent(f"""
            import sys
            sys.path[:0] = [{str(tmp_path)!r}, {str(ROOT)!r}]
            from air_router.cli.cli import main
            sys.exit(main({list(arguments)!r}))
        """)
        return subprocess.run(
            [sys.executable, "-c", program],
            capture_output=True,
            text=True,
            check=False,
            timeout=120,
        )

    good = run("check", str(mission))
    assert (good.returncode, "(nearest)" in good.stdout) == (0, True), good.stderr
    mission.write_text(text.replace("seek: nearest", "seek: tour"), encoding="utf-8")
    program = (
        "from air_router.seek_policies import policy_of; print(type(policy_of('tour')).__module__)"
    )
    printed = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}"},
    )
    assert printed.stdout == "air_router.controller.targets.tour\n"
    mission.write_text(text.replace("seek: nearest", "seek: broken"), encoding="utf-8")
    bad = run("check", str(mission))
    assert bad.returncode == ExitCode.INVALID_FILE
    assert "'broken' of the package 'acme-seek' cannot be loaded: AttributeError" in bad.stderr
    assert "Traceback" not in bad.stderr
