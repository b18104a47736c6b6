"""The simulated autopilot, as PX4 1.17 behaves. Pure."""
