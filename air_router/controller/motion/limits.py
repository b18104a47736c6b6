"""Numbers that tune this room: each with its unit, and why it is what it is."""

from typing import Final

# For command_gate.py

RETRY_S: Final = 3.0
"""Pause before something that could not be done is tried again."""

ANNOUNCE_AGAIN_S: Final = 10.0
"""Pause before another reason to hover is announced."""

JUMPS: Final = 4
"""After so many jumps that the vehicle did not follow, its plan is left alone."""

REACTION_S: Final = 0.6
"""Flight time between the telemetry that a decision rests on and the vehicle braking: a PX4 takes
half a second to build its deceleration up, and the link its time."""

POSITION_EVERY_S: Final = 0.1
"""The vehicle sends its position so often: that which a motion was decided on is so old at most
when it leaves, beside what the companion takes itself."""

FAR_M: Final = 5.0
"""The target that it reports counts from here on: nearer, its stopping distance covers it,
and where it hovers it is as far off as estimates wander."""

TURNING_S: Final = 0.3
TURNING_S2_M: Final = 1 / 12
"""A vehicle that is turned away just before the end of its leg swings beyond it: by its way in that
time, and by what braking at 2 instead of 3 m/s2 takes more while it speeds up sideways."""

# For initial_climb.py

ALTITUDE_M: Final = 2.0
"""PX4 corrects its home altitude in flight, so that an altitude above home is good to this."""

CLIMB_S: Final = 20.0
PROGRESS_M: Final = 0.5
"""A climb that gains less than this in that time does not go on; PX4 takes off at 1.5 m/s."""

# For navigator.py

STOP_S: Final = 4.0
"""What stopping and setting out again takes: a way that avoids it may be longer by so much."""

RECHECK_S: Final = 2.0
RECHECKS: Final = 5
"""How long apart, and how often, a vehicle that stands checks again for a clear leg on."""

STALL_S: Final = 15.0
"""A vehicle that was sent somewhere and stands for so long did not understand, or may not go."""

ASTRAY_M: Final = 2.0
"""Farther than this from what was checked for a leg, it is checked again from there."""

WANDERS_M: Final = 0.1
"""So far apart are two positions of a hovering vehicle that follow each other, by their noise."""

# For way_out.py

REACH_M: Final = 500.0
"""So far around the vehicle a way out is planned off the cruise altitudes: to work out all of a
large airspace takes long, and the vehicle waits in a zone."""
