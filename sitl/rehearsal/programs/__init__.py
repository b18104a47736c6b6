"""Rehearsed flights of the real programs: `air-router fly` against `sitl vehicle` or a PX4."""

from sitl.rehearsal.programs.flight import SPEED, RealFlight
from sitl.rehearsal.programs.processes import OURS
from sitl.rehearsal.programs.scenes import WIRE, WireScene, wire_scenes

__all__ = [
    "OURS",
    "SPEED",
    "WIRE",
    "RealFlight",
    "WireScene",
    "wire_scenes",
]
