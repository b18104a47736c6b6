"""The mission controller: telemetry and events in, actions out. Pure."""
