"""Geometry of a mission: frame, airspace, clear paths and grids. Imports no package of ours."""
