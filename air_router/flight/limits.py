"""Numbers that tune this room: each with its unit, and why it is what it is."""

from typing import Final

# For flight.py

VEHICLE_RESTART_S: Final = 5.0
"""A vehicle whose clock decreases by more than this has restarted. `POSITION_AHEAD_S` in
px4/limits.py, by which one message may be ahead of the next, is smaller."""

VEHICLE_LOST_S: Final = 60.0
"""Wall-clock silence after which the vehicle is lost, also before its first position."""

# For flight_loop.py

COMMAND_S: Final = 0.12
"""Wall-clock time from a telemetry message to the resulting command at the vehicle, including a
mode change; `benchmarks.clearance` measures it."""

# For flight_stats.py

OFF_GROUND_M: Final = 2.0
"""A vehicle that was never higher above home has not flown: PX4 corrects home by as much."""

WAY_STEP_M: Final = 2.0
"""Step of the flown distance: a hovering vehicle's estimate wanders by less."""

CHANGES_KEPT: Final = 16
"""Number of latest changes of state shown in flight; the record has all."""

TRACK_STEP_M: Final = 0.05
"""Positions closer than this to the last one add nothing to a track but noise."""

# For flight_view.py

DEGREE_DIGITS: Final = 8
"""Decimals of a degree for other programs: a millimeter."""

# For lag_watch.py; from `LAG_HOLD_S` of the controller on, each lag is reported

LAG_CHECK_S: Final = 0.1
"""Interval of measurements of the event loop's lag: five within the shortest lag that counts."""

LAG_STOOD_S: Final = 0.5
"""A turn with this lag is reported. Garbage collection, a page and a map take 50 ms."""

LAG_STARVED_S: Final = 3.0
LAG_STARVED_WITHIN_S: Final = 10.0
"""This total lag within that time is reported even without a single long lag: 30 % of the
processor."""

LAG_REPEATED_S: Final = 30.0
"""Shortest interval of reports, except for a lag that makes the vehicle hold: a busy processor
stays busy, and the pilot has other messages to read."""

# For mission_reloader.py

PLAN_ON_BOARD_S: Final = 60.0
"""Wall-clock limit for the upload of a changed plan; over a poor link it is restarted."""

# For resumption.py

RESUMED_RECORDS: Final = 5
"""Most records read from the folder, newest first: the vehicle waits meanwhile, and the record to
resume is the newest except for a false start or two."""

RESUMED_CLOCKS_APART_S: Final = 30.0
RESUMED_CLOCKS_APART: Final = 0.2
"""Largest difference between the vehicle's clock and ours over the time since the record ended. A
vehicle that landed since, and stayed powered, has taken off after the recorded flight."""

# For status_source.py

LINKS_REFRESH_S: Final = 0.5
"""Largest age of the links in a status: measuring them takes the node's lock."""

# For terminal.py

TERMINAL_REFRESH_S: Final = 0.25
"""Interval of updates of the status line, no faster than it can be read."""

TERMINAL_PLAIN_REFRESH_S: Final = 10.0
"""Without a terminal: interval of status lines, instead of one line that is redrawn."""

TERMINAL_READ_AGAIN_S: Final = 0.5
"""Pause before a terminal without input (Ctrl-D, background) is read again."""
