"""Many nodes, all in mutual range: as processes, and whole neighbourhoods in simulated time."""
