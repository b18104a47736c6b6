"""The simulated autopilot, as PX4 1.17 behaves, or others that were flown. Pure."""
