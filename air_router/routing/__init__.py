"""Routes: the waypoint graph, its planners, first legs, and the ways home."""
