"""Rehearsed flights of the real programs: `air-router fly` against `sitl vehicle` or a PX4."""
