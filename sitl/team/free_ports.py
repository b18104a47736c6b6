"""Teams that disturb no program: any, on loopback addresses and free ports, and a built-in one."""

import random
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from air_router.errors import AirRouterError
from air_router.sim.ports import PORTS, is_free
from mocha_link.team.document import Document
from mocha_link.team.team import Robot, Team

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


def derive_team(team: Team, directory: Path, name: str = "team.yaml") -> Team:
    """Write a copy of the team, with free loopback addresses and ports, into a directory.

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
            path = directory / name
            path.write_text(candidate.dump(), encoding="utf-8")
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
    return all(
        is_free(kind, host, port)
        for kind, host, port in (
            *_tcp_places(robot),
            (socket.SOCK_DGRAM, robot.listen, robot.base_port + len(robot.clients)),
        )
    )


def _tcp_places(robot: Robot) -> Iterator[tuple[socket.SocketKind, str, int]]:
    for offset in range(len(robot.clients)):
        for host in (robot.address, robot.listen):
            yield socket.SOCK_STREAM, host, robot.base_port + offset
