"""Whether a mission's team fits it: who flies, whom it seeks, and how robots are found."""

import difflib
from collections.abc import Collection

from air_router.files.mission_document import Keys, MissionDocument
from air_router.messages import GOALS_TOPIC, SEEK_TOPIC
from air_router.mission.found_by import UAV_KIND, pose_topic, sought, why_not_found
from mocha_link.team.document import Document, DocumentError
from mocha_link.team.team import Team


def check_team(draft: MissionDocument) -> None:
    """Note what is wrong with the team file, and robots that it does not have.

    Enters the only flying robot of the team as the draft's `uav`, if the mission names none.
    """
    if draft.world is not None and not draft.world.is_file():
        draft.report(
            ("world",), f"there is no file {draft.world}; correct the path", "no-such-file"
        )
    if len(set(draft.seek)) < len(draft.seek):
        message = "a robot is named twice; each is sought in turn anyway"
        draft.report(("seek", "robots"), message, "named-twice")
    if draft.team is None:
        return
    if not draft.team.is_file():
        draft.report(("team",), f"there is no file {draft.team}; correct the path", "no-such-file")
        return
    try:
        document = Document.load(draft.team)
        team = Team.from_document(document)
    except DocumentError as error:
        draft.problems.extend(error.problems)
        return
    if draft.uav is not None:
        of_several = [uav.keys for uav in draft.uavs if uav.name == draft.uav]
        _check_flies(draft, draft.uav, team, (of_several or [("uav",)])[0])
        _note_unlinked_uavs(draft, team)
    else:
        _choose(draft, team)
    _check_others(draft, team)
    uav = str(draft.uav)
    names = sought(team, uav, draft.seek, draft.goals_from) if uav in team.robots else draft.seek
    for name in names:
        if name in team.robots and pose_topic(team, name) is None:
            message = why_not_found(team, name)
            draft.problems.append(document.problem(("robots", name), message, "found-by-nothing"))


def _check_flies(draft: MissionDocument, name: str, team: Team, keys: Keys) -> None:
    _check_robot(draft, name, team.robots, keys)
    if name not in team.robots or team.robot(name).kind == UAV_KIND:
        return
    flying = [robot.name for robot in team.robots.values() if robot.kind == UAV_KIND]
    named = f"name {' or '.join(flying)}, or " if flying else ""
    message = (
        f"'{name}' is of kind {team.robot(name).kind} in the team file and does not fly; "
        f"{named}give it the kind {UAV_KIND}"
    )
    draft.report(keys, message, "does-not-fly")


def _choose(draft: MissionDocument, team: Team) -> None:
    """Enter the only flying robot of the team, or note that it is not clear who flies."""
    flying = [name for name, robot in team.robots.items() if robot.kind == UAV_KIND]
    if len(flying) == 1:
        draft.uav = flying[0]
        return
    advice = f"give the one that flies this mission the kind {UAV_KIND} in {team.path}"
    if flying and draft.source.path.suffix.lower() == ".plan":
        advice = f"say which one flies this plan: {' or '.join(f'--uav {n}' for n in flying)}"
    elif flying:
        advice = "add 'uav' with the name of the robot that flies this mission"
    message = f"the team has {len(flying)} robots of kind {UAV_KIND}; {advice}"
    draft.report((), message, "who-flies")


def _check_others(draft: MissionDocument, team: Team) -> None:
    """Note robots that are to be sought, or sent goals by, and cannot."""
    for index, name in enumerate(draft.seek):
        _check_robot(draft, name, team.robots, ("seek", "robots", index))
        if name == draft.uav:
            message = f"'{name}' flies this mission; take it off the list"
            draft.report(("seek", "robots", index), message, "seeks-itself")
    for index, name in enumerate(draft.goals_from):
        _check_goals(draft, name, team, ("goals_from", index))


def _check_goals(draft: MissionDocument, name: str, team: Team, keys: Keys) -> None:
    _check_robot(draft, name, team.robots, keys)
    if name == draft.uav:
        message = f"'{name}' flies this mission; goals come from others: take it off the list"
        draft.report(keys, message, "seeks-itself")
    elif name in team.robots and GOALS_TOPIC not in {t.name for t in team.topics_of(name)}:
        message = (
            f"'{name}' has no topic {GOALS_TOPIC} in the team file, so that it can send none; "
            "add {name: /goals, type: json/Goals, priority: high}"
        )
        draft.note(keys, message, "no-goals-topic")


def _note_unlinked_uavs(draft: MissionDocument, team: Team) -> None:
    """Note UAVs of one mission that cannot tell each other whom they seek."""
    own = next((uav for uav in draft.uavs if uav.name == draft.uav), None)
    if own is None or own.name not in team.robots or len(draft.uavs) == 1:
        return
    known = {own.name, *team.robot(own.name).peers}
    unlinked = [uav.name for uav in draft.uavs if uav.name not in known]
    if unlinked:
        names = " and ".join(f"'{name}'" for name in unlinked)
        message = (
            f"'{own.name}' has no link with {names} in the team file, so that they may seek the "
            "same robot; make them clients of each other"
        )
        draft.note(own.keys, message, "uavs-not-linked")
    if SEEK_TOPIC not in {topic.name for topic in team.topics_of(own.name)}:
        message = (
            f"'{own.name}' has no topic {SEEK_TOPIC} in the team file, so that others may seek the "
            "robot that it seeks; add {name: /seek, type: json/Seek}"
        )
        draft.note(own.keys, message, "no-seek-topic")


def _check_robot(draft: MissionDocument, name: str, known: Collection[str], keys: Keys) -> None:
    if name in known:
        return
    close = difflib.get_close_matches(name, known, n=1)
    hint = f"did you mean '{close[0]}'?" if close else f"use one of {', '.join(sorted(known))}"
    draft.report(keys, f"the team has no robot '{name}'; {hint}", "unknown-robot")
