"""Numbers that tune this room: each with its unit, and why it is what it is."""

from typing import Final

# For mapper.py

RESOLUTION_M: Final = 1.0
"""Side of a cell of the map that a camera paints."""

MARGIN_M: Final = 60.0
"""Margin of the map beyond the flown area: about one camera footprint."""
