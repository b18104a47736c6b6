"""Numbers that tune this room: each with its unit, and why it is what it is."""

from typing import Final

# For flight.py

VEHICLE_RESTART_S: Final = 5.0
"""A vehicle whose clock runs back by more than this has restarted; `POSITION_AHEAD_S` of the PX4's
room, by which one message may be ahead of the next, is less."""

VEHICLE_LOST_S: Final = 60.0
"""Wall-clock silence of the vehicle after which it is lost, before its first position too."""

# For flight_loop.py

COMMAND_S: Final = 0.12
"""Wall-clock time from a telemetry message to its answer at the vehicle, a mode change included;
`benchmarks.clearance` measures it."""

# For flight_stats.py

OFF_GROUND_M: Final = 2.0
"""A vehicle that never was higher above home has not flown: PX4 corrects home by as much."""

WAY_STEP_M: Final = 2.0
"""What is flown counts in steps of this: a position estimate wanders by less while hovering."""

CHANGES_KEPT: Final = 16
"""So many changes of state, the newest, are shown while it flies; the record has all."""

TRACK_STEP_M: Final = 0.05
"""Positions closer than this to the last one add nothing to a track but noise."""

# For flight_view.py

DEGREE_DIGITS: Final = 8
"""Decimals of a degree in what other programs get: a millimetre."""

# For lag_watch.py; from `LAG_HOLD_S` of the controller on, each lag is reported

LAG_CHECK_S: Final = 0.1
"""How often the event loop's lag is measured: five times within the shortest lag that counts."""

LAG_STOOD_S: Final = 0.5
"""A turn that comes so late is reported. A search for garbage, a page and a map take 50 ms."""

LAG_STARVED_S: Final = 3.0
LAG_STARVED_WITHIN_S: Final = 10.0
"""So much lag in that time is reported, if no single turn is so late: 30 % of the processor."""

LAG_REPEATED_S: Final = 30.0
"""It is reported again no sooner, but for one that has the vehicle hold: a busy processor stays
busy, and the pilot has other things to read."""

# For mission_reloader.py

PLAN_ON_BOARD_S: Final = 60.0
"""Wall-clock limit for the changed plan to be on board; over a poor link it is begun again."""

# For resumption.py

RESUMED_RECORDS: Final = 5
"""So many records of the folder are read at most, the newest first: the vehicle waits
meanwhile, and the one to resume is the newest but for a false start or two."""

RESUMED_CLOCKS_APART_S: Final = 30.0
RESUMED_CLOCKS_APART: Final = 0.2
"""By so much the vehicle's clock and ours may differ in what has passed since the record ended. One
that has landed since, and was not switched off, has taken off after the flight of the record."""

# For status_source.py

LINKS_REFRESH_S: Final = 0.5
"""How old the links in a flight's status may be: measuring them takes the node's lock."""

# For terminal.py

TERMINAL_REFRESH_S: Final = 0.25
"""How often the status line is drawn: no faster than it can be read."""

TERMINAL_PLAIN_REFRESH_S: Final = 10.0
"""Where there is no terminal, a line now and then instead of one that is drawn over."""

TERMINAL_READ_AGAIN_S: Final = 0.5
"""A terminal that gave no line, at Ctrl-D or in the background, is read again after so long."""
