"""Who is who in a team that flies a mission, the pure world around it, and teams on free ports."""

import random
import socket
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Final

from air_router.errors import AirRouterError, ExitCode
from air_router.gossip import RESOLUTION_M
from air_router.mission import UAV_KIND, Mission
from air_router.sim import PORTS, is_free
from mocha_link.path_safety import new_file
from mocha_link.team import Document, Robot, Team
from sitl.team.nodes import RosMessages
from sitl.world import World, WorldPlan
from sitl.world.towns import Raster


class TeamError(AirRouterError):
    """The team does not fit the mission; the message says how."""

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


def make_world(
    mission: Mission,
    team: Team,
    roles: TeamRoles,
    plan: WorldPlan,
    played: Collection[str] = (),
) -> World:
    """The pure world of a mission: robots where they start.

    Those that are `played` by programs stand there, and say nothing by themselves.
    """
    corners = [corner for fence in mission.fences for corner in fence.corners]
    corners += [*(waypoint.position for waypoint in mission.waypoints), mission.home]
    raster = Raster.draw(plan.scene, corners, RESOLUTION_M, plan.margin_m)
    speech = RosMessages(team)
    topics = {name: () if name in played else speech.topics(name) for name in roles.ground}
    world = World(plan, mission.frame, roles.vehicles, raster, topics)
    for name in played:
        world.stand(name, world.robots[name].position)
    return world


# Teams on free ports.

_ATTEMPTS = 50

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


class NoFreePortsError(AirRouterError):
    """No free block of ports was found; the message says what to do."""


def derive_team(team: Team, directory: Path) -> Team:
    """Write a copy of the team, with free loopback addresses and ports: `team.yaml` in a directory.

    Each robot gets an address that the others dial and another one that its node listens on, so
    that relays fit in between. Simulations side by side land on different loopback networks.

    Raises:
        NoFreePortsError: nothing free was found, or this system has no 127.0.0.0/8.
        OSError: the directory cannot be written.
    """
    # Chosen by chance and not by the seed: runs with equal seeds are run side by side as well.
    chance = random.SystemRandom()
    for _ in range(_ATTEMPTS):
        candidate = team.with_robots(_places(team, chance))
        if all(_all_free(robot) for robot in candidate.robots.values()):
            directory.mkdir(parents=True, exist_ok=True)
            path = directory / "team.yaml"
            with new_file(path) as file:
                file.write(candidate.dump().encode())
            return Team.load(path)
    raise NoFreePortsError(
        f"found no free loopback ports in {_ATTEMPTS} attempts; the system must let programs bind "
        "any address of 127.0.0.0/8 (Linux does; on macOS: sudo ifconfig lo0 alias ADDRESS)"
    )


def _places(team: Team, chance: random.Random) -> dict[str, dict[str, object]]:
    network = f"127.{chance.randint(1, 254)}.{chance.randint(0, 255)}"
    needed = sum(len(robot.clients) + 1 for robot in team.robots.values())
    port = chance.randrange(PORTS.start, max(PORTS.start + 1, PORTS.stop - needed))
    places: dict[str, dict[str, object]] = {}
    for index, robot in enumerate(team.robots.values()):
        listen = f"{network}.{1 + index % 120}"
        places[robot.name] = {
            "address": f"{network}.{128 + index % 120}",
            "listen": listen,
            "base_port": port,
            "radio": f"udp://{listen}:{port + len(robot.clients)}",
            "key": None,  # the relays have none
        }
        port += len(robot.clients) + 1
    return places


def _all_free(robot: Robot) -> bool:
    count = len(robot.clients)
    radio = (socket.SOCK_DGRAM, robot.listen, robot.base_port + count)
    nodes = product((socket.SOCK_STREAM,), (robot.address, robot.listen), range(count))
    ports = [radio, *((kind, host, robot.base_port + offset) for kind, host, offset in nodes)]
    return all(is_free(*port) for port in ports)
