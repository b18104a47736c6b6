"""Missions, fences and rally points on board: stored, checked, ordered."""
