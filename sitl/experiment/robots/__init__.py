"""The robots of a run: base station, UAVs, and all gossip nodes."""

from sitl.experiment.robots.controllers import NO_POLICIES, controllers_of, scenery_of
from sitl.experiment.robots.node import REFRESH_S, Node, base_messages, fleet_of
from sitl.experiment.robots.uav import CAMERA, COMMAND_S, MapPainter, Uav

__all__ = [
    "CAMERA",
    "COMMAND_S",
    "NO_POLICIES",
    "REFRESH_S",
    "MapPainter",
    "Node",
    "Uav",
    "base_messages",
    "controllers_of",
    "fleet_of",
    "scenery_of",
]
