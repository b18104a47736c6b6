"""What the modes of the simulated autopilot decide on, and what it reports."""
