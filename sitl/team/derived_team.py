"""Copies of teams on free ports."""

import random
import socket
from itertools import product
from pathlib import Path

from air_router.errors import AirRouterError
from air_router.files import write_whole
from air_router.sim import PORTS, is_free
from mocha_link.team import Robot, Team

_ATTEMPTS = 50


class NoFreePortsError(AirRouterError):
    """No free block of ports was found; the message has a remedy."""


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
            write_whole(path, candidate.dump(), replace=True)
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
    nodes = product(
        (socket.SOCK_STREAM,), (robot.address or robot.listen, robot.listen), range(count)
    )
    ports = [radio, *((kind, host, robot.base_port + offset) for kind, host, offset in nodes)]
    return all(is_free(*port) for port in ports)
