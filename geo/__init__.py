"""Geometry of a mission: local frame, airspace, clear paths and semantic grids. Knows nobody."""
