"""The simulated world: a MAVLink vehicle that behaves as PX4 does, ground robots and radios."""

from air_router import __version__

__all__ = ["__version__"]
