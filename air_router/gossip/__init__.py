"""The UAV's gossip node: what it tells the team, and what the team tells the mission."""
