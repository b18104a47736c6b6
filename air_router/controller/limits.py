"""Numbers that tune this room: each with its unit, and why it is what it is."""

from typing import Final

# For airspace_update.py

WAY_OUT_RETRY_S: Final = 3.0
"""Pause before the next search for a way out of a new zone."""

ALL_ZONES_ABOVE_M: Final = 50.0
"""With the altitude in doubt, zones up to this far above the cruise altitudes apply.

A barometer that drifts by 0.3 m/s is off by less during a return of two or three minutes. Files of
whole countries contain airspace classes that begin higher and cover everything; they would block
every way."""

BRAKING_OVERSHOOT: Final = 1.5
"""A braking vehicle may need this many times the computed distance."""

# For command_handler.py

VEHICLE_SILENT_S: Final = 3.0
"""A vehicle silent for longer is not sent anywhere: its position is unknown."""

# For conditions.py

CONDITIONS_WORSE_S: Final = 3.0
"""Conditions must be worse for this long before the vehicle holds: readings flicker."""

CONDITIONS_GOOD_S: Final = 5.0
"""Conditions count as good again after this long."""

CONDITIONS_HOME_S: Final = 30.0
"""The vehicle comes home after this long: a longer wait uses the charge for the way home."""

# For control_authority.py

RELEASE_HOLDS: Final = 6
"""Number of hold commands before a vehicle that does not follow is released."""

PLAN_COMPARED_S: Final = 60.0
"""A plan not compared within this time counts as another one: the link is too poor."""

REPEATED_AFTER_S: Final = 10.0
"""Interval of repeated announcements."""

LINK_SILENCE_ALARM_S: Final = 10.0
LINK_SILENCE_BY_HAND_S: Final = 20.0
"""A silence this long is an alarm; after the second time the pilot takes over."""

LINK_SILENCE_ANNOUNCED_S: Final = 3.0
"""A shorter silence is not announced."""

FAILSAFE_LATE_S: Final = 2.5
"""A failsafe may be visible this much later than its mode: HEARTBEAT is sent once a second."""

# For deviations.py

DEVIATION_HOLD_S: Final = 2.0
"""A vehicle that holds for a deviation hovers after this time, and resumes."""

DEVIATION_TIMES: Final = 3
DEVIATION_WITHIN_S: Final = 180.0
"""After this many holds within this time, another hold will not help."""

# For envelope.py

OFF_ALTITUDE_M: Final = 5.0
"""Smallest limit for a vehicle off its altitudes, whatever the mission's margin: PX4 corrects
home's altitude by more than 2 m in flight."""

OFF_ALTITUDE_S: Final = 4.0
"""Time off the altitudes without coming nearer before it is announced."""

BACK_AT_ALTITUDE_S: Final = 2.0
"""Time at the altitudes before the vehicle counts as back."""

OFF_ALTITUDE_HOME_S: Final = 30.0
"""Time off the altitudes before the vehicle comes home."""

NEARER_ALTITUDE_M: Final = 0.5
"""A climb or descent that gains this much makes progress."""

ALTITUDE_JUMP_M: Final = 2.5
ALTITUDE_JUMP_CLIMB_M_S: Final = 6.0
"""An altitude change above `ALTITUDE_JUMP_M` plus a climb at this speed was not flown."""

CLEARANCE_NOISE_M: Final = 0.25
"""Noise of a position: no loss of clearance."""

CLEARANCE_REPEATED_M: Final = 1.0
"""A lost clearance is announced again when this much more is lost."""

OVERSPEED_M_S: Final = 0.5
OVERSPEED: Final = 1.1
OVERSPEED_S: Final = 2.0
"""No gust makes a vehicle faster than this for this long."""

UNDERSPEED: Final = 0.6
UNDERSPEED_S: Final = 5.0
UNDERSPEED_LEG_M: Final = 10.0
"""With more than `UNDERSPEED_LEG_M` of a leg left, a vehicle is faster than this share after some
seconds."""

# For lag_monitor.py

LAG_HOLD_S: Final = 2.0
"""After a stall this long the vehicle holds before it resumes: 10 m at 5 m/s were flown
unmonitored, more than the clearance of most missions."""

TELEMETRY_GAP_S: Final = 0.5
"""The track between two telemetry updates farther apart than this was not checked."""

LAG_RECENT_S: Final = 5.0
"""An input missing this soon after a stall may wait in this program's sockets: no warning."""

LAG_STEP_M: Final = 0.5

# For safety_monitor.py

DISARMED_S: Final = 10.0
"""A landed vehicle without HEARTBEAT for this long counts as disarmed."""

KILLED_M: Final = 3.0
"""A vehicle disarmed below this altitude has landed."""

REST_M: Final = 0.5
REST_S: Final = 2.0
"""A fallen vehicle is on the ground once its altitude changes by less than this in this time."""

TWINS_S: Final = 5.0
"""Two vehicles with one system id have both reported within this time."""

HOME_MOVED_AGAIN_M: Final = 2.0
"""A moved home is announced again when it has moved by this much more."""

PX4_SETS_HOME_S: Final = 5.0
"""PX4 sets home on its own at lift-off, and may do so without satellites. A change this soon after
that was not made by a ground station."""

POSITION_UNKNOWN_S: Final = 2.0
"""The alarm for an unknown position comes after this long, while another flies the vehicle."""

ALTITUDE_DISAGREES_M: Final = 3.5
ALTITUDE_DISAGREES_HOME_M: Final = 6.0
"""A receiver's altitude with a fix is accurate to about 2 m; the plan assumes 5 m."""

ALTITUDE_AVERAGE_S: Final = 4.0
ALTITUDE_SAMPLE_M: Final = 7.0
ALTITUDE_SAMPLE_S: Final = 0.5
"""Limits of a single altitude's deviation and duration in the average. A very wrong altitude raises
the average by less than `ALTITUDE_DISAGREES_M` in the 1.5 s in which it is accepted."""

FOREIGN_ORDER_S: Final = 1.5
"""How long a foreign command must be visible: on a slow link our own is visible late."""

ORDER_STALE_S: Final = 5.0
"""An older report does not show the current command."""

OLD_POSITION_S: Final = 2.0
"""A position this old may predate the braking, so its target proves nothing."""

FOREIGN_TARGET_M: Final = 4.0
"""A target this far from ours is a foreign one; PX4's position estimate wanders less."""

BRAKED_S: Final = 3.0
"""After this long in Hold the vehicle hovers where our hold stopped it."""

HOVERS_M: Final = 2.0
"""A stopped vehicle nearer than this to its reported target hovers there.

A vehicle farther away still reports the target from before the stop: its stream may be late."""

HOVERS_M_S: Final = 1.0
"""A faster vehicle has not stopped yet."""

HOLD_STOPS_M: Final = 15.0
"""The vehicle stops within this distance; a target farther away is a foreign command."""

# For standstill.py

MOVED_M: Final = 3.0
"""Distance in any direction that counts as moving: a hovering vehicle wanders by less, and the
slowest landing (0.3 m/s) takes 10 s for it."""

STANDS_IN_ZONE_S: Final = 15.0
"""Stopping takes 4 s, a lost command is repeated after 3 s, a route is planned in 2 s, and the
first `MOVED_M` take 2 s. A vehicle that has not begun to leave a zone by then will not."""

STANDS_S: Final = 30.0
"""Every wait of a healthy flight ends sooner: after 15 s for a leg that is not followed, after 30 s
for an altitude jump."""

STANDS_FOR_PLAN_S: Final = 90.0
"""A plan is uploaded and read back within 10 s; over a poor link within a minute."""

SETS_OUT_S: Final = 10.0
"""A blocked vehicle moves this soon after the interlock clears: after a fix (3 s) a leg is planned,
commanded and followed."""

STANDSTILL_CHECK_S: Final = 1.0
"""Interval of checks of a vehicle that does not move."""
