"""The UDP path, pure: packets, pacing, what has arrived."""
