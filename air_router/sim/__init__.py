"""Starts a simulated world around a flight, each part in its own process."""

from air_router.sim.ports import PORTS, free_port, is_free
from air_router.sim.sim_world import Child

__all__ = [
    "PORTS",
    "Child",
    "free_port",
    "is_free",
]
