"""The simulated world: robots, radio, terrain, cameras."""
