"""Numbers that tune this room: each with its unit, and why it is what it is."""

from typing import Final

# For explore_state.py

PASSING_M: Final = 15.0
"""A waypoint passed this closely counts as searched when a robot is sought."""

# For goto_state.py

SETTLING_S: Final = 10.0
"""Longest wait at a point for the vehicle to hover still; in gusts it may never do."""

# For ready_state.py

HOME_TOLERANCE_M: Final = 20.0
"""The vehicle must start this close to the mission's home; else the mission is for another site."""

# For return_state.py

POSITION_S: Final = 1.0
"""With an older position the vehicle is not known to be above home."""

LANDING_M: Final = 1.0
"""A landing may begin this much farther from home than the acceptance radius."""

WIDEST_M: Final = 2.0
"""Largest acceptance radius used for a landing: the ground was checked at home only."""

CHECK_S: Final = 5.0
"""Interval of checks for a way home; zones that change are checked at once."""

ANNOUNCE_AGAIN_S: Final = 30.0
"""Interval of repeated announcements that there is no way home."""

NAMED: Final = 3
"""Number of walls named in an announcement; a pilot reads no more in flight."""

# For search_state.py

FOLLOW_M: Final = 8.0
"""A robot that has moved this far from the hover or search position is followed."""

SEEK_AGAIN_S: Final = 10.0
"""Pause before the next attempt when no robot could be sought."""
