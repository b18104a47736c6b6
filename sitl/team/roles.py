"""Who is who in a team that flies a mission, and a team that is built in."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from air_router.errors import AirRouterError, ExitCode
from air_router.mission import UAV_KIND, Mission
from mocha_link.team import Document, Team


class TeamError(AirRouterError):
    """The team does not fit the mission; the message has the reason."""

    exit_code = ExitCode.INVALID_FILE


@dataclass(frozen=True, slots=True)
class TeamRoles:
    """Who is who in a team: the vehicles that fly the mission, and the robots on the ground.

    The first vehicle is the one whose clock is the world's.
    """

    vehicles: tuple[str, ...]
    ground: tuple[str, ...]


def roles_of(mission: Mission, team: Team) -> TeamRoles:
    """Who flies and who drives. Aerial robots that the mission is not for are not simulated.

    Raises:
        TeamError: it is not clear who flies, or no robot drives.
    """
    flying = [name for name, robot in team.robots.items() if robot.kind == UAV_KIND]
    vehicle = mission.uav
    if vehicle is None and len(flying) == 1:
        vehicle = flying[0]
    if vehicle is None or vehicle not in team.robots:
        raise TeamError(
            f"{team.path}: which robot flies this mission? set 'uav' in the mission to one of "
            f"{', '.join(team.robots)}"
        )
    ground = tuple(name for name in team.robots if name != vehicle and name not in flying)
    if not ground:
        raise TeamError(f"{team.path}: no robot drives on the ground; add a robot of another kind")
    others = (layer.uav for layer in mission.layers if layer.uav != vehicle)
    return TeamRoles((vehicle, *others), ground)


def check_rovers(names: Iterable[str], roles: TeamRoles, team: Team) -> None:
    """Check that programs play only robots that drive on the ground.

    Raises:
        TeamError: one of the names is no such robot.
    """
    if strangers := sorted(set(names) - set(roles.ground)):
        raise TeamError(
            f"--rover {strangers[0]}=...: no robot of {team.path} that drives on the ground is "
            f"called '{strangers[0]}'; use one of {', '.join(roles.ground)}"
        )


_TEXT: Final = """
robots:
  titan: {kind: aerial_robot, address: 127.0.1.4, listen: 127.0.0.4, base_port: 24400,
          clients: [callisto, europa, io]}
  callisto: {kind: ground_robot, address: 127.0.1.1, listen: 127.0.0.1, base_port: 24100,
             clients: [europa, io, titan]}
  europa: {kind: ground_robot, address: 127.0.1.2, listen: 127.0.0.2, base_port: 24200,
           clients: [callisto, io, titan]}
  io: {kind: ground_robot, address: 127.0.1.3, listen: 127.0.0.3, base_port: 24300,
       clients: [callisto, europa, titan]}
kinds:
  aerial_robot:
    topics:
      - {name: /map, type: grid/SemanticMap, priority: high, min_interval_s: 5}
      - {name: /pose, type: json/Pose, priority: none, min_interval_s: 1}
  ground_robot:
    topics:
      - {name: /pose, type: json/Pose, priority: high, min_interval_s: 1}
      - {name: /path, type: json/Path, priority: medium}
      - {name: /sightings, type: json/Sightings, priority: low}
"""


def default_team() -> Team:
    """Titan flies; callisto, europa and io drive. Its ports have still to be chosen."""
    return Team.from_document(Document.from_text(_TEXT, Path("the built-in team")))
