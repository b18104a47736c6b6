"""Numbers that tune this room: each with its unit, and why it is what it is."""

from typing import Final

# For command_gate.py

RETRY_S: Final = 3.0
"""Pause before a failed motion or plan is retried."""

ANNOUNCE_AGAIN_S: Final = 10.0
"""Pause before another reason to hover is announced."""

JUMPS: Final = 4
"""After this many jumps that the vehicle did not follow, DO_REPOSITION replaces the plan."""

REACTION_S: Final = 0.6
"""Time between the telemetry of a decision and the vehicle braking: PX4 needs half a second to
build up deceleration, the link needs the rest."""

POSITION_EVERY_S: Final = 0.1
"""Interval of the vehicle's position messages. A motion is sent at most this long after the
position it was decided on, plus the companion's own delay."""

FAR_M: Final = 5.0
"""A reported target counts only beyond this distance. A nearer one is covered by the stopping
distance, and a hovering vehicle's target wanders with its estimate."""

TURNING_S: Final = 0.3
TURNING_S2_M: Final = 1 / 12
"""A vehicle that turns just before the end of its leg overshoots it by the distance flown in
`TURNING_S`, plus the extra stopping distance at 2 instead of 3 m/s2 while it accelerates
sideways."""

# For initial_climb.py

ALTITUDE_M: Final = 2.0
"""PX4 corrects its home altitude in flight; an altitude above home is accurate to this."""

CLIMB_S: Final = 20.0
PROGRESS_M: Final = 0.5
"""A climb that gains less than `PROGRESS_M` in `CLIMB_S` is stuck; PX4 takes off at 1.5 m/s."""

# For navigator.py

STOP_S: Final = 4.0
"""Time lost by stopping and setting out again. A way that avoids a stop may be longer by this."""

RECHECK_S: Final = 2.0
RECHECKS: Final = 5
"""Interval and number of checks for a clear next leg while the vehicle hovers."""

STALL_S: Final = 15.0
"""A vehicle that hovers this long after a command did not receive it, or cannot follow it."""

ASTRAY_M: Final = 2.0
"""A vehicle farther than this from the area checked for its leg is checked again from there."""

WANDERS_M: Final = 0.1
"""Noise between two consecutive positions of a hovering vehicle."""

# For way_out.py

REACH_M: Final = 500.0
"""Radius around the vehicle in which a way out is planned off the cruise altitudes. Planning in all
of a large airspace takes long, and the vehicle waits in a zone meanwhile."""
