"""Numbers that tune this room: each with its unit, and why it is what it is."""

from typing import Final

# For airframe.py; all three count HEARTBEATs

ANOTHER_TYPE_HEARTBEATS: Final = 2
ANOTHER_TYPE_WINDOW: Final = 6
"""Number of the latest HEARTBEATs that show another vehicle; a single one may be a stray frame."""

ANOTHER_TYPE_CLEARED: Final = 10
"""HEARTBEATs without the other vehicle until it counts as gone: ten seconds, at 1 Hz."""

# For battery.py

CHARGE_JUMP: Final = 0.05
"""A larger change between two messages, as a share of a full battery, is a jump. With 20 minutes
for a full battery 5 % take a minute; PX4 reports the charge every second."""

CHARGE_BELIEVED_S: Final = 3.0
"""A charge after a jump is accepted after this time: at 5 m/s it costs 15 m of the way home."""

VOLTAGE_DROP: Final = 0.05
"""The charge is accepted at once if the voltage has dropped by this share. A load causes a smaller,
longer sag; one failing cell of four takes a quarter."""

# For clock.py

PACE_ALLOWANCE_S: Final = 0.2
"""Simulated seconds by which a world that waits for its participants may be ahead of the
slowest."""

CLOCK_RATE_WINDOW_S: Final = 0.3
"""Wall time over which the clock's rate against ours is measured: three positions, at 10 Hz."""

CLOCK_RATE_MOST: Final = 200.0
"""Highest plausible rate: twice the highest rate of a simulation. A window above it contains
messages that had waited."""

CLOCK_RATE_SAMPLES: Final = 30
CLOCK_RATE_SAMPLE_S: Final = 0.03
"""Number and interval of samples of the rate: over three windows."""

CLOCK_RATE_TOLERANCE: Final = 0.25
"""Two windows that differ by no more than this share of the larger rate measure the same rate."""

REBOOT_S: Final = 1.0
"""A time earlier than the newest by more than this shows a reboot: messages overtake each other by
less (`POSITION_BACK_S` in px4/limits.py)."""

CLOCK_EXTRAPOLATED_S: Final = 2.0
"""Wall time for which the clock is extrapolated after the last message; then it stops."""

UNIX_TIME_SET_S: Final = 2.0
"""A vehicle's Unix time ahead of its first one by more than this has been set since."""

UNIX_TIME_STEADY_S: Final = 0.2
"""Largest difference between two messages of a clock that runs with the vehicle's."""

# For height_frame.py

HOME_MOVED_UP_M: Final = 4.0
"""PX4 1.17 corrects its home's altitude in flight, by up to 2.3 m as measured. That is no move. A
mission keeps 5 m of vertical margin."""

HOME_MOVED_ASIDE_M: Final = 3.0
"""In flight PX4 never moves its home horizontally on its own."""

# For input_limits.py, beside the table of inputs there

INPUT_REPEATED_S: Final = 30.0
"""Interval of repeated announcements of a missing input."""

INPUT_BACK_S: Final = 3.0
"""An input counts again after it has been received for this long without a break."""

LANDED_STATE_S: Final = 5.0
"""An older landed state is not used; see `Streams.in_air` in px4."""

FLIGHT_MODE_S: Final = 5.0
"""An older flight mode may be outdated: HEARTBEAT is sent at 1 Hz; see `LIMITS`."""

FIX_ALARM_S: Final = 5.0
"""A fix lost for this long raises an alarm: PX4's own failsafe may act."""

# For pace.py

PACE_STEP_S: Final = 0.02
"""The simulated vehicle's step: a shorter one needs no report."""

PACE_CONNECT_S: Final = 2.0
"""Wall-clock limit for an answer of the world that sets the pace."""

# For vehicle.py

TARGET_REACHED_UP_M: Final = 6.0
"""Vertical tolerance of a reached target: PX4 corrects home's altitude by less."""
