"""Ground robots that look for vehicles in a town: what they know, decide and tell."""

from sitl.world.explorers.exploration import Exploration, first_visits
from sitl.world.explorers.explorer import NO_VEHICLE_M, GroundRobot, Visit
from sitl.world.explorers.messages import CLAIMS_TOPIC, OBJECTS_TOPIC, REACHABILITY_TOPIC, degrees
from sitl.world.explorers.settings import ExplorerSettings, PlacedBy, Positive

__all__ = [
    "CLAIMS_TOPIC",
    "NO_VEHICLE_M",
    "OBJECTS_TOPIC",
    "REACHABILITY_TOPIC",
    "Exploration",
    "ExplorerSettings",
    "GroundRobot",
    "PlacedBy",
    "Positive",
    "Visit",
    "degrees",
    "first_visits",
]
