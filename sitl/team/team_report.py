"""What became of the ground robots in a simulation: contacts, data, maps, as one JSON object."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from mocha_link.store import Message
from sitl.team.nodes import GroundNodes
from sitl.team.truth import SimClock
from sitl.world import World
from sitl.world.explorers import GroundRobot


def report(world: World, nodes: GroundNodes, clock: SimClock) -> dict[str, Any]:
    """The report of a simulation, ready for JSON. Times are Unix seconds of the simulation."""
    now_s = clock.now_s()
    faults = world.policy_faults
    messages = {name: node.messages() for name, node in nodes.nodes.items()}
    return {
        "ended_s": now_s,
        "simulated_s": clock.elapsed_s,
        "robots": {
            name: {
                **_motion(world, name),
                "contacts": _contacts(world, name),
                "syncs": {
                    peer: {
                        "in": link.syncs_in,
                        "out": link.syncs_out,
                        "bytes_in": link.bytes_in,
                        "bytes_out": link.bytes_out,
                        "timeouts": link.timeouts,
                    }
                    for peer, link in nodes.nodes[name].links().items()
                },
                "holds": [
                    {
                        "robot": message.robot,
                        "topic": message.topic,
                        "stamp_s": message.stamp_s,
                        "age_s": now_s - message.stamp_s,
                    }
                    for message in messages[name]
                ],
                "map": nodes.keepers[name].newest,
                "map_history": list(map(list, nodes.keepers[name].history)),
                "maps_refused": nodes.keepers[name].refused,
                "policy_fault": faults.get(name),
            }
            for name in world.robots
        },
        "carried": _carried(world, messages),
        "goals": {
            "total": world.goals_total,
            "found": [
                {"goal": visit.goal, "robot": visit.robot, "at_s": visit.time_s}
                for visit in world.goals
            ],
        },
        "vehicles": [
            {
                "pair": [a, b],
                "contacts": world.contact(a, b).count,
                "contact_s": round(world.contact(a, b).seconds, 1),
                "closest_m": _finite(approach.closest_m),
                "across_m": _finite(approach.across_m),
                "up_m": _finite(approach.up_m),
                "at_s": approach.at_s,
                "level_m": _finite(approach.level_m),
            }
            for (a, b), approach in world.approaches.items()
        ],
    }


def _carried(world: World, messages: Mapping[str, Sequence[Message]]) -> list[list[str]]:
    """Pairs [a, b] of ground robots that never had contact while a holds data of b."""
    return [
        [holder, maker]
        for holder in world.robots
        for maker in world.robots
        if holder != maker
        and world.contact(holder, maker).count == 0
        and any(message.robot == maker for message in messages[holder])
    ]


def _motion(world: World, name: str) -> dict[str, Any]:
    robot = world.robots[name]
    place = world.frame.to_geodetic(robot.position)
    return {
        "position": {
            "latitude_deg": place.latitude_deg,
            "longitude_deg": place.longitude_deg,
            "east_m": robot.position.east_m,
            "north_m": robot.position.north_m,
        },
        "driven_m": robot.driven_m,
        "vehicles_seen": len(robot.sightings),
        **({"errand_s": robot.errand_s} if isinstance(robot, GroundRobot) else {}),
    }


def _contacts(world: World, name: str) -> dict[str, Any]:
    peers = (*world.vehicles, *world.robots)
    contacts = {peer: world.contact(name, peer) for peer in peers if peer != name}
    return {
        peer: {
            "count": contact.count,
            "seconds": round(contact.seconds, 3),
            "last_s": contact.last_s,
            "closest_m": _finite(contact.closest_m),
        }
        for peer, contact in contacts.items()
    }


def _finite(value: float) -> float | None:
    return round(value, 3) if math.isfinite(value) else None


class TeamPace:
    """How fast the world went, and in what steps."""

    def __init__(self) -> None:
        self._began: tuple[float, float] | None = None  # simulated and wall time of the first step
        self._now = (0.0, 0.0)  # the same, of the last step
        self._longest_step_s = 0.0  # simulated

    def stepped(self, time_s: float, wall_s: float) -> None:
        """The world was moved on to this simulated time, at this time of a steady clock."""
        if self._began is None:
            self._began = self._now = (time_s, wall_s)
        self._longest_step_s = max(self._longest_step_s, time_s - self._now[0])
        self._now = (time_s, wall_s)

    def as_json(self) -> dict[str, float | None]:
        """Simulated seconds per wall-clock second, and the longest step in simulated seconds."""
        simulated_s, wall_s = (
            now - then for now, then in zip(self._now, self._began or self._now, strict=True)
        )
        return {
            "kept": round(simulated_s / wall_s, 2) if wall_s > 0 else None,
            "longest_step_s": round(self._longest_step_s, 2),
        }
