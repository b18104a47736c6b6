"""Policies of ground robots: where they drive, what they may see, and what a fault does."""

import itertools
import math
import runpy
import subprocess
import sys

import pytest
from pydantic import ValidationError

from air_router.errors import ExitCode
from air_router.messages import MAP_TOPIC, POSE_TOPIC, PoseMessage
from geo.frame import Point
from sitl.experiment.campaign import running
from sitl.experiment.plan_file import load_experiment
from sitl.robot_policies import POLICY_TOPIC, Drive, RobotPolicyError
from sitl.robot_policies.template import PATIENCE_S, ComesBack
from sitl.robot_policies.testing import check, views
from sitl.world.explorers.exploration import Exploration
from sitl.world.explorers.policies import robot_policy_of
from sitl.world.explorers.settings import ExplorerSettings
from sitl.world.towns.town import REACHED_M
from sitl.world.towns.town_file import load_town
from tests.distributions import ROOT
from tests.docs.blocks import blocks

TOWN = load_town(ROOT / "missions" / "urban" / "town.yaml")
HERE = __name__


class Stays:
    """Where it is when it is called first."""

    place = None

    def choose(self, view):
        self.place = self.place or view.position
        return Drive(self.place)


class ToTheFarthest:
    def choose(self, view):
        reachable = [goal for goal in view.goals if view.way_m(goal) < 1e6]
        if view.goal is not None:
            return Drive(view.goal)
        return Drive(reachable[-1]) if reachable else None


class Fails:
    def choose(self, view):
        if view.now_s > 100.0:
            raise ZeroDivisionError("no way")


SEEN = []


class Looks:
    def choose(self, view):
        SEEN.append(view)


class Turns:
    """Looks for goals for a minute, then comes back."""

    def choose(self, view):
        return None if view.now_s < 60.0 else Drive(view.start)


def robots(policy):
    settings = ExplorerSettings(policy=None if policy is None else f"{HERE}:{policy}")
    found = Exploration(TOWN, ("ugv01", "ugv02"), 3, settings, drawn_starts=True).robots()
    for robot in found.values():  # all know the whole town, and all goals
        robot.knowledge.learn(TOWN.ground)
        robot.book.learn(goal.position for goal in TOWN.goals)
    return found


def driven(policy, seconds=300):
    found = robots(policy)
    for robot in found.values():
        for now_s in range(seconds):
            robot.step(float(now_s))
    return found


def test_a_robot_stays_where_its_policy_has_it_stay():
    assert {robot.driven_m for robot in driven("Stays").values()} == {0.0}
    assert any(robot.driven_m > 0 for robot in driven(None).values())


def test_a_goal_that_a_policy_chooses_is_claimed_as_any_other():
    starts = {name: robot.position for name, robot in robots(None).items()}
    near, far = driven(None, 60), driven("ToTheFarthest", 60)
    for name, start in starts.items():
        goals = [each[name].book.current for each in (near, far)]
        assert None not in goals
        assert math.dist(start, goals[0]) < math.dist(start, goals[1])


def test_a_goal_under_way_is_given_back():
    robot = robots("Turns")["ugv01"]
    start = robot.position
    for now_s in range(60):
        robot.step(float(now_s))
    taken = robot.book.current
    assert taken is not None
    for now_s in range(60, 400):
        robot.step(float(now_s))
    assert robot.book.current is None
    assert taken not in robot.book.failed
    assert taken in robot.book.free(robot.position)
    assert math.dist(robot.position, start) <= REACHED_M


def test_a_policy_that_fails_leaves_the_robot_to_look_for_goals():
    own, reference = driven("Fails"), driven(None)
    assert {robot.policy.fault for robot in own.values()} == {"ZeroDivisionError: no way"}
    for name, robot in own.items():
        assert robot.position == reference[name].position
        assert robot.visited == reference[name].visited


def test_a_view_has_the_newest_message_of_each_robot_and_topic():
    SEEN.clear()
    robot = robots("Looks")["ugv01"]
    robot.step(0.0)
    for stamp_s, data in ((1.0, b"one"), (2.0, b"two")):
        robot.take("io", "/something", data, stamp_s)
    for now_s in range(3, 20):
        robot.step(float(now_s))
    received = SEEN[-1].received["io", "/something"]
    assert (received.data, received.at_s) == (b"two", 2.0)
    with pytest.raises(TypeError):
        SEEN[-1].received["io", "/something"] = received


class Joins:
    """Goes where another robot reports to be."""

    def choose(self, view):
        if (pose_message := view.received.get(("ugv02", POSE_TOPIC))) is None:
            return None
        pose = PoseMessage.decode(pose_message.data)
        return Drive(view.frame.to_local(pose.latitude_deg, pose.longitude_deg))


def test_a_robot_can_go_where_another_one_reports_to_be():
    found = robots("Joins")
    one, other = found["ugv01"], found["ugv02"]
    other.step(0.0)
    other.step(1.0)
    published = dict(other.outbox())[POSE_TOPIC]
    assert math.dist(one.position, other.position) > 2 * REACHED_M
    one.step(0.0)
    one.take("ugv02", POSE_TOPIC, published, 0.0)
    for now_s in range(1, 2000):
        one.step(float(now_s))
    assert math.dist(one.position, other.position) <= 2 * REACHED_M


class Publishes:
    message = None

    def choose(self, view):
        self.message = b"at %d" % (view.now_s // 20)


class PublishesTooMuch:
    message = bytes(5000)

    def choose(self, view):
        return None


def test_the_message_of_a_policy_is_published_when_it_has_changed():
    robot = robots("Publishes")["ugv01"]
    published = []
    for now_s in range(60):
        robot.step(float(now_s))
        published += [data for topic, data in robot.outbox() if topic == POLICY_TOPIC]
    assert published == [b"at 0", b"at 1", b"at 2"]


def test_a_policy_whose_message_is_too_long_is_at_fault():
    robot = driven("PublishesTooMuch", 10)["ugv01"]
    assert "not at most 4096 bytes or None" in robot.policy.fault
    with pytest.raises(AssertionError, match="not at most 4096 bytes"):
        check(PublishesTooMuch)


def test_an_experiment_has_its_faults_in_the_record(tmp_path):
    path = tmp_path / "own.yaml"
    path.write_text(
        "name: own\ntitle: Robots of our own\nrows: [{town: urban, uavs: 1, ugvs: 2, "
        f"duration_s: 200, explorer: {{policy: '{HERE}:Fails'}}}}]\n"
    )
    experiment, _ = load_experiment(str(path))
    record = running.make_run(experiment.task(experiment.rows[0], 0))
    assert record["faults"] == dict.fromkeys(("ugv01", "ugv02"), "ZeroDivisionError: no way")


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("no_such_package:Policy", "cannot be loaded: ModuleNotFoundError"),
        (f"{HERE}:NoSuchClass", "cannot be loaded: AttributeError"),
        (f"{HERE}:HERE", "is no class"),
        ("builtins:object", "is no robot policy"),
        ("builtins:zip", "is no robot policy"),
        ("nonesuch", "no robot policy is called 'nonesuch'"),
    ],
)
def test_what_cannot_be_loaded_is_one_clear_error(name, why):
    with pytest.raises(RobotPolicyError, match=why) as refused:
        robot_policy_of(name)
    assert refused.value.exit_code == ExitCode.INVALID_FILE


def test_a_file_that_names_none_is_wrong():
    with pytest.raises(ValidationError, match=r"package\.module:Class"):
        ExplorerSettings(policy="nonesuch")


def test_the_template_waits_at_its_start_without_maps():
    chosen = check(ComesBack)
    for view, drive in zip(views(), chosen, strict=True):
        maps = [own.at_s for (_, topic), own in view.received.items() if topic == MAP_TOPIC]
        silent = view.now_s - max(maps, default=0.0) >= PATIENCE_S
        assert drive == (Drive(view.start) if silent else None)
    assert None in chosen
    assert len(set(chosen)) == 2


COUNT = itertools.count()


class Restless:
    def choose(self, view):
        return Drive(Point(float(next(COUNT)), 0.0))


class Nowhere:
    def choose(self, view):
        return Drive(Point(float("nan"), 0.0))


class Text:
    def choose(self, view):
        return "home"


@pytest.mark.parametrize(
    ("policy", "why"),
    [
        (Restless, "another object chooses otherwise"),
        (Nowhere, "no finite Point"),
        (Text, "not a Drive or None"),
        (object, "has no choose"),
    ],
)
def test_what_breaks_the_contract_is_reported(policy, why):
    with pytest.raises(AssertionError, match=why):
        check(policy)


def test_the_template_is_printed_and_in_the_docs(tmp_path):
    command = [sys.executable, "-m", "sitl.robot_policies"]
    printed = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT).stdout
    path = tmp_path / "my_robots.py"
    path.write_text(printed, encoding="utf-8")
    assert check(runpy.run_path(str(path))["ComesBack"])
    assert printed.strip() in {
        block.text.strip() for block in blocks() if block.page.name == "town.md"
    }
