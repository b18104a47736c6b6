"""The simulated world: a MAVLink vehicle that behaves as PX4 does, ground robots and radios."""

__version__ = "0.2.0.dev0"  # its own: what judges a flight imports nothing of what it judges
