"""The simulated world: a MAVLink vehicle that behaves as PX4 does, ground robots and radios."""
