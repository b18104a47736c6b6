"""Mission files: YAML, QGroundControl plans, waypoint files; read and written."""
