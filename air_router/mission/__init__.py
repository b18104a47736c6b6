"""The mission: loaded, validated, divided among UAVs, and as a plan for the autopilot."""
