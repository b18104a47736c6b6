"""Numbers that tune this room: each with its unit, and why it is what it is."""

from typing import Final

# For explore_state.py

PASSING_M: Final = 15.0
"""Passing a waypoint so closely counts as having been there when we search for a lost robot."""

# For goto_state.py

SETTLING_S: Final = 10.0
"""So long a vehicle may take at a point until it stands; in gusts it perhaps never does."""

# For ready_state.py

HOME_TOLERANCE_M: Final = 20.0
"""The vehicle must start this close to the mission's home, or it is another place's mission."""

# For return_state.py

POSITION_S: Final = 1.0
"""A vehicle whose positions have been missing for longer is not known to be above home."""

LANDING_M: Final = 1.0
"""So much farther from home than the acceptance radius it may be when it is commanded to land."""

WIDEST_M: Final = 2.0
"""A wider acceptance radius counts for no landing: what is below was checked for home alone."""

CHECK_S: Final = 5.0
"""How often the program checks whether there is a way; at once after zones have changed."""

ANNOUNCE_AGAIN_S: Final = 30.0
"""How often it is announced again that there is none."""

NAMED: Final = 3
"""So many walls are named; more would not be read in the air."""

# For search_state.py

FOLLOW_M: Final = 8.0
"""A robot that has moved so far from where we hover (or search) is followed."""

SEEK_AGAIN_S: Final = 10.0
"""Pause before the robots are gone through again when none of them could be sought."""
