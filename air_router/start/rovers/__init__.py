"""Rovers of fifteen lines: docs/robot.md shows them, `air-router new` copies them."""
