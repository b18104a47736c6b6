"""Numbers that tune this room: each with its unit, and why it is what it is."""

from typing import Final

# For airframe.py; all three count HEARTBEATs

ANOTHER_TYPE_HEARTBEATS: Final = 2
ANOTHER_TYPE_WINDOW: Final = 6
"""Another vehicle in so many of the latest HEARTBEATs is there; in one it may be a stray frame."""

ANOTHER_TYPE_CLEARED: Final = 10
"""It is there no more after so many HEARTBEATs without it: ten seconds, at 1 Hz."""

# For battery.py

CHARGE_JUMP: Final = 0.05
"""A charge that changes by more than this share of a full battery from one message to the next has
jumped. At 20 minutes for a full battery, 5 % take a minute; PX4 reports the charge every second."""

CHARGE_BELIEVED_S: Final = 3.0
"""A charge that has jumped is believed after so long: at 5 m/s that costs 15 m of the way home."""

VOLTAGE_DROP: Final = 0.05
"""Where the voltage has fallen by this share as well, it is believed at once. A load makes a pack
sag by less for longer; a cell of four that fails takes a quarter."""

# For clock.py

PACE_ALLOWANCE_S: Final = 0.2
"""Simulated seconds by which a world that waits for its parts may be ahead of the slowest."""

CLOCK_RATE_WINDOW_S: Final = 0.3
"""Wall time over which the clock's rate against ours is measured: three positions, at 10 Hz."""

CLOCK_RATE_MOST: Final = 200.0
"""Seconds of the vehicle a second: twice as fast as a simulation is asked to run at most. A window
with more is of messages that had waited."""

CLOCK_RATE_SAMPLES: Final = 30
CLOCK_RATE_SAMPLE_S: Final = 0.03
"""How often, and how long apart, a rate is sampled: over three windows."""

CLOCK_RATE_TOLERANCE: Final = 0.25
"""Two windows that differ by no more than this share of the larger rate measure the same one."""

REBOOT_S: Final = 1.0
"""A time that is earlier than the newest by more than this is of a vehicle that has rebooted:
messages overtake each other by less (`POSITION_BACK_S` of the PX4's room)."""

CLOCK_EXTRAPOLATED_S: Final = 2.0
"""Wall time for which the clock is carried on after the last message; then it stands still."""

UNIX_TIME_SET_S: Final = 2.0
"""A vehicle's Unix time that is so much ahead of what it was by its first was set since."""

UNIX_TIME_STEADY_S: Final = 0.2
"""By less two messages differ of a clock that runs with the vehicle's; they come each second."""

# For height_frame.py

HOME_MOVED_UP_M: Final = 4.0
"""PX4 1.17 corrects the altitude of its home in flight, by up to 2.3 m as measured: that it follows
is right, and no move. A mission keeps 5 m from what is above and below it."""

HOME_MOVED_ASIDE_M: Final = 3.0
"""In flight PX4 moves its home to no side by itself."""

# For input_limits.py, beside the table of inputs there

INPUT_REPEATED_S: Final = 30.0
"""How often an input that is missing is announced again while it lasts."""

INPUT_BACK_S: Final = 3.0
"""An input counts again after it has come for so long: what comes and goes is no input."""

LANDED_STATE_S: Final = 5.0
"""A landed state older than this is not believed: see `Streams.in_air` of the PX4's room."""

FLIGHT_MODE_S: Final = 5.0
"""A flight mode older than this may not be so any more: HEARTBEAT comes at 1 Hz; see `LIMITS`."""

FIX_ALARM_S: Final = 5.0
"""A fix that is lost for so long is an alarm: PX4's own failsafe may act."""

# For pace.py

PACE_STEP_S: Final = 0.02
"""The vehicle's step: there is nothing to report of less."""

PACE_CONNECT_S: Final = 2.0
"""Wall-clock limit for the world that sets the pace to answer."""

# For vehicle.py

TARGET_REACHED_UP_M: Final = 6.0
"""A target that is no farther up or down is there: PX4 corrects the altitude of home by less."""
