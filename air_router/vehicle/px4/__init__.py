"""A PX4 vehicle: commands, plans, telemetry, through MAVSDK."""
