"""What telemetry shows that was not decided: breaches, deviations, phases, home out of reach."""
