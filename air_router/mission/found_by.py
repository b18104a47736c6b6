"""By which of its topics a robot of the team is found: the first that says where it is.

JSON is known by its topic's name, a ROS message by its type, whatever its topic is called.
"""

from typing import Final

from air_router.messages import JSON_PACKAGE, PATH_TOPIC, POSE_TOPIC
from air_router.mission.mission import Mission
from mocha_link.team.team import Team, Topic

UAV_KIND: Final = "aerial_robot"
"""The kind of the team's robots that fly; without `uav` in the mission, the only one is meant."""

FIX: Final = "sensor_msgs/NavSatFix"
POSE: Final = "geometry_msgs/PoseStamped"
LOCAL_POSES: Final = (
    POSE,
    "nav_msgs/Odometry",
    "geometry_msgs/PoseWithCovarianceStamped",
)
"""In metres of a robot's local frame: they say something where the team file has its `datum`."""

PATH: Final = "nav_msgs/Path"

_GOAL: Final = "goal"
"""A pose of ROS on a topic with this in its name is where a robot is to go, not where it is."""


def sought(
    team: Team, uav: str, seek: tuple[str, ...], goals_from: tuple[str, ...]
) -> tuple[str, ...]:
    """Whom a UAV seeks: those that its mission names, or else all that drive and have a link to it.

    A base station that sends goals, and nothing that says where it is, is not sought by itself.
    """
    return seek or tuple(
        peer
        for peer in team.robot(uav).peers
        if team.robot(peer).kind != UAV_KIND
        and (peer not in goals_from or pose_topic(team, peer) is not None)
    )


def pose_topic(team: Team, robot: str) -> Topic | None:
    """The topic by which a robot is found; None: by none."""
    return _first(team, robot, POSE_TOPIC, (FIX, *LOCAL_POSES))


def finders(mission: Mission) -> dict[str, Topic]:
    """By which topic each robot that a mission seeks is found; those of no topic are left out.

    Raises:
        DocumentError: the team file cannot be read.
    """
    if mission.team is None or mission.uav is None:
        return {}
    team = Team.load(mission.team)
    names = sought(team, mission.uav, mission.seek, mission.goals_from)
    found = {name: pose_topic(team, name) for name in names}
    return {name: topic for name, topic in found.items() if topic is not None}


def path_topic(team: Team, robot: str) -> Topic | None:
    """The topic that says where a robot will drive; None: none."""
    return _first(team, robot, PATH_TOPIC, (PATH,))


def why_not_found(team: Team, robot: str) -> str:
    """Why a robot is found by none of its topics, and what to do."""
    local = next((topic for topic in team.topics_of(robot) if _says(topic, LOCAL_POSES)), None)
    if local is not None:
        return (
            f"'{robot}' is sought and says where it is in metres of a frame of its own "
            f"({local.name}, {local.type}); say where on Earth that begins, with 'datum: "
            f"[latitude, longitude]' of {robot}"
        )
    return (
        f"'{robot}' is sought, and none of its topics says where it is; give its kind one that "
        f"does, e.g. {{name: {POSE_TOPIC}, type: json/Pose}} or {{name: /fix, type: {FIX}}}, or "
        "name under 'seek' in the mission whom to seek"
    )


def _first(team: Team, robot: str, by_name: str, by_type: tuple[str, ...]) -> Topic | None:
    placed = team.robot(robot).datum is not None
    for topic in team.topics_of(robot):
        if topic.name == by_name and topic.type.startswith(JSON_PACKAGE):
            return topic
        if _says(topic, by_type) and (placed or topic.type == FIX):
            return topic
    return None


def _says(topic: Topic, types: tuple[str, ...]) -> bool:
    return topic.type in types and _GOAL not in topic.name
