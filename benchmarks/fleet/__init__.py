"""Many nodes that all hear each other: as processes, and whole neighbourhoods in simulated time."""
