"""Numbers that tune this room: each with its unit, and why it is what it is."""

from typing import Final

# For standing_alarms.py

ESCALATES_S: Final = 10.0
"""An alarm that lasts this long is repeated, and instructs the pilot to take over."""

REPEATED_S: Final = 30.0
"""Interval of further repetitions: a pilot who flies by hand hears other announcements, too."""
