"""Flies a PX4 vehicle around no-fly zones and decides from its links when to seek the robots."""

__version__ = "0.2.0.dev0"
