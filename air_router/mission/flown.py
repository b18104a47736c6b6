"""A mission as one vehicle flies it: which of its UAVs that is, and the team that it talks to."""

from datetime import datetime
from pathlib import Path

from air_router.errors import RefusedError, UsageError
from air_router.mission.found_by import UAV_KIND, pose_topic, sought, why_not_found
from air_router.mission.loading import load_mission
from air_router.mission.mission import Mission
from mocha_link import Team


def team_of(mission: Mission, path: Path | None) -> tuple[Team, str]:
    """The team to talk to, and the name that the mission's UAV has in it."""
    path = path or mission.team
    if path is None:
        raise RefusedError(
            f"{mission.path}: names no team file, so there is no peer to talk to; "
            "add `team: team.yaml` to it or say --team FILE"
        )
    team = Team.load(path)
    uav = mission.uav or only_uav(team)
    for name in sought(team, uav, mission.seek, mission.goals_from):
        if pose_topic(team, name) is None:
            raise RefusedError(f"{path}: {why_not_found(team, name)}")
    return team, uav


def load_flown(
    path: Path,
    uav: str | None,
    *,
    start: datetime | None = None,
    duration_s: float | None = None,
    in_flight: bool = False,
) -> Mission:
    """A mission as one vehicle flies it, or has begun to fly it.

    Raises:
        MissionFileError: it cannot be flown.
        UsageError: it is for several UAVs, and `uav` is none of them.
    """
    mission = load_mission(path, uav=uav, start=start, duration_s=duration_s, in_flight=in_flight)
    if uav is None and len(mission.layers) > 1:
        names = " or ".join(f"--uav {layer.uav}" for layer in mission.layers)
        raise UsageError(f"{path}: is for several UAVs; say which one this is: {names}")
    return mission


def only_uav(team: Team) -> str:
    """The team's UAV, for missions that do not say which robot they fly."""
    uavs = [robot.name for robot in team.robots.values() if robot.kind == UAV_KIND]
    if len(uavs) != 1:
        raise RefusedError(
            f"{team.path}: has {len(uavs)} robots of kind {UAV_KIND}; "
            "say which one flies, --uav NAME or `uav: NAME` in the mission"
        )
    return uavs[0]
