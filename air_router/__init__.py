"""Flies a PX4 vehicle around no-fly zones and decides from its links when to seek the robots."""
