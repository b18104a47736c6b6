"""Checks a mission against its team: the UAV, the robots to seek, and their position topics.

A robot is found by the first of its topics that gives a position. JSON is recognized by the name of
its topic, a ROS message by its type.
"""

import difflib
import json
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Final

from air_router.errors import RefusedError
from air_router.files import Findings, Keys, MissionForm, is_file
from air_router.files.missions import PlacedForm, other_kind
from air_router.messages import GOALS_TOPIC, JSON_PACKAGE, PATH_TOPIC, POSE_TOPIC, SEEK_TOPIC
from air_router.mission.mission import Mission
from mocha_link.team import Document, DocumentError, Team, Topic, path_advice

UAV_KIND: Final = "aerial_robot"
"""The kind of flying robots; a mission without `uav` uses the only one of the team."""

FIX: Final = "sensor_msgs/NavSatFix"
POSE: Final = "geometry_msgs/PoseStamped"
LOCAL_POSES: Final = (
    POSE,
    "nav_msgs/Odometry",
    "geometry_msgs/PoseWithCovarianceStamped",
)
"""Positions in metres of the robot's local frame; usable if the team file has its `datum`."""

PATH: Final = "nav_msgs/Path"

_GOAL: Final = "goal"
"""A ROS pose on a topic with this in its name is a goal, not the robot's position."""


def sought(
    team: Team, uav: str, seek: tuple[str, ...], goals_from: tuple[str, ...]
) -> tuple[str, ...]:
    """The robots that a UAV seeks: those of its mission, or else all linked ground robots.

    A base station that sends goals but reports no position is not sought by default.
    """
    return seek or tuple(
        peer
        for peer in team.robot(uav).peers
        if team.robot(peer).kind != UAV_KIND
        and (peer not in goals_from or pose_topic(team, peer) is not None)
    )


def pose_topic(team: Team, robot: str) -> Topic | None:
    """The topic by which a robot is found; None: there is none."""
    return _first(team, robot, POSE_TOPIC, (FIX, *LOCAL_POSES))


def finders(mission: Mission) -> dict[str, Topic]:
    """The position topic of each robot to seek; robots without one are omitted.

    Raises:
        DocumentError: The team file cannot be read.
    """
    if mission.team is None or mission.uav is None:
        return {}
    team = Team.load(mission.team)
    names = sought(team, mission.uav, mission.seek, mission.goals_from)
    found = {name: pose_topic(team, name) for name in names}
    return {name: topic for name, topic in found.items() if topic is not None}


def path_topic(team: Team, robot: str) -> Topic | None:
    """The topic of a robot's planned path; None: there is none."""
    return _first(team, robot, PATH_TOPIC, (PATH,))


def why_not_found(team: Team, robot: str) -> str:
    """Why a robot cannot be found by any of its topics, and the remedy."""
    local = next((topic for topic in team.topics_of(robot) if _is_of(topic, LOCAL_POSES)), None)
    if local is not None:
        return (
            f"'{robot}' is sought and reports its position in metres of a frame of its own "
            f"({local.name}, {local.type}); write where on Earth that begins, with 'datum: "
            f"[latitude, longitude]' of {robot}"
        )
    return (
        f"'{robot}' is sought, and none of its topics has its position; give its kind one that "
        f"does, e.g. {{name: {POSE_TOPIC}, type: json/Pose}} or {{name: /fix, type: {FIX}}}, or "
        "name under 'seek' in the mission whom to seek"
    )


def _first(team: Team, robot: str, by_name: str, by_type: tuple[str, ...]) -> Topic | None:
    placed = team.robot(robot).datum is not None
    for topic in team.topics_of(robot):
        if topic.name == by_name and topic.type.startswith(JSON_PACKAGE):
            return topic
        if _is_of(topic, by_type) and (placed or topic.type == FIX):
            return topic
    return None


def _is_of(topic: Topic, types: tuple[str, ...]) -> bool:
    return topic.type in types and _GOAL not in topic.name


# The mission and its team file

ALONE: Final = Path("(no team)")
"""Displayed as the team path of a mission without a team."""

_ALONE: Final = """
robots: {{{name}: {{kind: aerial_robot, address: 127.0.0.1, base_port: 24400, clients: []}}}}
kinds:
  aerial_robot:
    topics: [{{name: /map, type: grid/SemanticMap, priority: high, min_interval_s: 5}}]
"""
"""The team of a mission without a team: the UAV alone, without links."""


def team_of(mission: Mission, path: Path | None) -> tuple[Team, str]:
    """The team of a mission, and the name of its UAV in the team.

    Without a team the UAV explores alone and comes home.

    Raises:
        RefusedError: The mission seeks robots without a team, the UAV is ambiguous, or a robot to
            seek reports no position.
        DocumentError: The team file is invalid.
    """
    path = path or mission.team
    if path is None and mission.seek:
        raise RefusedError(
            f"{mission.path}: seeks {', '.join(mission.seek)}, but names no team file; "
            "add `team: team.yaml` to it or pass --team FILE"
        )
    if path is None:
        name = mission.uav or "uav"
        text = _ALONE.format(name=json.dumps(name))
        return Team.from_document(Document.from_text(text, ALONE)), name
    team = Team.load(path)
    uav = mission.uav or only_uav(team)
    for name in sought(team, uav, mission.seek, mission.goals_from):
        if pose_topic(team, name) is None:
            raise RefusedError(f"{path}: {why_not_found(team, name)}")
    return team, uav


def only_uav(team: Team) -> str:
    """The team's only UAV, for missions without `uav`."""
    uavs = _flying(team)
    if len(uavs) != 1:
        raise RefusedError(
            f"{team.path}: has {len(uavs)} robots of kind {UAV_KIND}; "
            "choose the one that flies, --uav NAME or `uav: NAME` in the mission"
        )
    return uavs[0]


def _flying(team: Team) -> list[str]:
    return [name for name, robot in team.robots.items() if robot.kind == UAV_KIND]


def check_team(placed: PlacedForm, findings: Findings) -> str | None:
    """Report problems of the team file, and robots missing in it.

    Returns:
        The mission's UAV: the form's `uav`, or else the only flying robot of the team.
    """
    form, several = placed.form, [uav.name for uav in placed.uavs]
    _check_file("world", form.world_file, findings)
    if len(set(form.seek.robots)) < len(form.seek.robots):
        message = "a robot is named twice; each is sought in turn anyway"
        findings.report(("seek", "robots"), message, "named-twice")
    path = form.team_file
    if path is None or not _check_file("team", path, findings):
        return form.uav
    try:
        document = Document.load(path)
        if other := other_kind(document.data, "team"):
            message = f"{path} is {other}; name the team's file"
            findings.report(("team",), message, "wrong-file")
            return form.uav
        team = Team.from_document(document)
    except DocumentError as error:
        findings.problems += error.problems
        return form.uav
    uav = form.uav
    if uav is None:
        uav = _only_one(form, team, findings)
    else:
        _check_flies(uav, team, ("uavs", uav) if uav in several else ("uav",), findings)
        _note_unlinked_uavs(uav, several, team, findings)
    _check_others(uav, form, team, findings)
    robots = tuple(form.seek.robots)
    if uav is not None and uav in team.robots:
        robots = sought(team, uav, robots, tuple(form.goals_from))
    for name in robots:
        if name in team.robots and pose_topic(team, name) is None:
            message = why_not_found(team, name)
            findings.report(("robots", name), message, "found-by-nothing", document)
    return uav


def _check_file(key: str, path: Path | None, findings: Findings) -> bool:
    if path is None or is_file(path):
        return True
    findings.report((key,), f"there is no file {path}; {path_advice(path)}", "no-such-file")
    return False


def _check_flies(name: str, team: Team, keys: Keys, findings: Findings) -> None:
    _check_robot(name, team.robots, keys, findings)
    if name not in team.robots or team.robot(name).kind == UAV_KIND:
        return
    flying = _flying(team)
    named = f"name {' or '.join(flying)}, or " if flying else ""
    message = (
        f"'{name}' is of kind {team.robot(name).kind} in the team file and does not fly; "
        f"{named}give it the kind {UAV_KIND}"
    )
    findings.report(keys, message, "does-not-fly")


def _only_one(form: MissionForm, team: Team, findings: Findings) -> str | None:
    """The only flying robot of the team; None, with a problem reported, if there is not one."""
    flying = _flying(team)
    if len(flying) == 1:
        return flying[0]
    advice = f"give the one that flies this mission the kind {UAV_KIND} in {team.path}"
    if flying and form.path.suffix.lower() == ".plan":
        advice = f"choose the one that flies this plan: {' or '.join(f'--uav {n}' for n in flying)}"
    elif flying:
        advice = "add 'uav' with the name of the robot that flies this mission"
    message = f"the team has {len(flying)} robots of kind {UAV_KIND}; {advice}"
    findings.report((), message, "who-flies")
    return None


def _check_others(uav: str | None, form: MissionForm, team: Team, findings: Findings) -> None:
    """Report invalid robots in `seek` and `goals_from`, and note names that differ in case only."""
    first: dict[str, str] = {}
    for name in team.robots:
        other = first.setdefault(name.lower(), name)
        if other != name:
            message = f"'{other}' and '{name}' of the team differ in case only; rename one"
            findings.note(("team",), message, "names-alike")
    for index, name in enumerate(form.seek.robots):
        keys: Keys = ("seek", "robots", index)
        _check_robot(name, team.robots, keys, findings)
        if name == uav:
            message = f"'{name}' flies this mission; take it off the list"
            findings.report(keys, message, "seeks-itself")
    for index, name in enumerate(form.goals_from):
        keys = ("goals_from", index)
        _check_robot(name, team.robots, keys, findings)
        if name == uav:
            message = f"'{name}' flies this mission; goals come from others: take it off the list"
            findings.report(keys, message, "seeks-itself")
        elif name in team.robots and GOALS_TOPIC not in {t.name for t in team.topics_of(name)}:
            message = (
                f"'{name}' has no topic {GOALS_TOPIC} in the team file, so that it can send none; "
                "add {name: /goals, type: json/Goals, priority: high}"
            )
            findings.note(keys, message, "no-goals-topic")


def _note_unlinked_uavs(uav: str, several: Sequence[str], team: Team, findings: Findings) -> None:
    """Note UAVs of one mission that cannot exchange which robots they seek."""
    if uav not in several or uav not in team.robots or len(several) == 1:
        return
    known, keys = {uav, *team.robot(uav).peers}, ("uavs", uav)
    unlinked = [name for name in several if name not in known]
    if unlinked:
        names = " and ".join(f"'{name}'" for name in unlinked)
        message = (
            f"'{uav}' has no link with {names} in the team file, so that they may seek the "
            "same robot; make them clients of each other"
        )
        findings.note(keys, message, "uavs-not-linked")
    if SEEK_TOPIC not in {topic.name for topic in team.topics_of(uav)}:
        message = (
            f"'{uav}' has no topic {SEEK_TOPIC} in the team file, so that others may seek the "
            "robot that it seeks; add {name: /seek, type: json/Seek}"
        )
        findings.note(keys, message, "no-seek-topic")


def _check_robot(name: str, known: Collection[str], keys: Keys, findings: Findings) -> None:
    if name in known:
        return
    same = [other for other in known if other.lower() == name.lower()]
    close = same or difflib.get_close_matches(name, known, n=1)
    hint = f"did you mean '{close[0]}'?" if close else f"use one of {', '.join(sorted(known))}"
    findings.report(keys, f"the team has no robot '{name}'; {hint}", "unknown-robot")
