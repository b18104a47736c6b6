"""Whom and what to seek next, and where: robots, waypoints, search points."""
