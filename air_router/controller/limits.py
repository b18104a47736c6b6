"""Numbers that tune this room: each with its unit, and why it is what it is."""

from typing import Final

# For airspace_update.py

WAY_OUT_RETRY_S: Final = 3.0
"""How long after no way led out of a new zone the program checks for again."""

ALL_ZONES_ABOVE_M: Final = 50.0
"""With the altitude in doubt zones count that begin up to so far above the cruise altitudes.

A barometer that drifts by 0.3 m/s is off by less in the two or three minutes that a way home takes.
The files of whole countries have classes of airspace that begin higher, over everything: among
those no way would be left."""

BRAKING_OVERSHOOT: Final = 1.5
"""A vehicle that brakes may come so much farther than is reckoned with."""

# For command_handler.py

VEHICLE_SILENT_S: Final = 3.0
"""A vehicle that was silent for so long is not sent anywhere: its position is unknown."""

# For conditions.py

CONDITIONS_WORSE_S: Final = 3.0
"""How long they are worse before it is held for: receivers and gusts flicker."""

CONDITIONS_GOOD_S: Final = 5.0
"""They count as good again after so long."""

CONDITIONS_HOME_S: Final = 30.0
"""After so long it comes home: waiting longer costs the battery that the way takes."""

# For control_authority.py

RELEASE_HOLDS: Final = 6
"""How often a vehicle is commanded to hold before hands are off though it does not."""

PLAN_COMPARED_S: Final = 60.0
"""A plan that was not compared within this time counts as another: the link is too poor."""

REPEATED_AFTER_S: Final = 10.0
"""How often something that goes on is announced."""

LINK_SILENCE_ALARM_S: Final = 10.0
LINK_SILENCE_BY_HAND_S: Final = 20.0
"""A silence that lasts so long is an alarm; then the pilot is to fly it by hand."""

LINK_SILENCE_ANNOUNCED_S: Final = 3.0
"""A shorter silence is not announced."""

FAILSAFE_LATE_S: Final = 2.5
"""A failsafe may show so long after the mode that it chose: HEARTBEAT comes once a second."""

# For deviations.py

DEVIATION_HOLD_S: Final = 2.0
"""A vehicle that holds for a deviation stands after so long, and goes on."""

DEVIATION_TIMES: Final = 3
DEVIATION_WITHIN_S: Final = 180.0
"""What has happened so often in that time will happen again."""

# For envelope.py

OFF_ALTITUDE_M: Final = 5.0
"""How far off its altitudes a vehicle may be at least, whatever margin the mission keeps: PX4
corrects the altitude of home by more than 2 m while it flies."""

OFF_ALTITUDE_S: Final = 4.0
"""How long the vehicle is off its altitudes, and comes no nearer, before that is announced."""

BACK_AT_ALTITUDE_S: Final = 2.0
"""It counts as back after so long."""

OFF_ALTITUDE_HOME_S: Final = 30.0
"""After so long off its altitudes it comes home."""

NEARER_ALTITUDE_M: Final = 0.5
"""A climb or descent that gains so much goes on."""

ALTITUDE_JUMP_M: Final = 2.5
ALTITUDE_JUMP_CLIMB_M_S: Final = 6.0
"""An altitude that changes by more than this, on top of what a climb at that speed makes in the
time, has not been flown."""

CLEARANCE_NOISE_M: Final = 0.25
"""What a position wanders by is no loss of clearance."""

CLEARANCE_REPEATED_M: Final = 1.0
"""A clearance that was lost is announced again when so much more of it is."""

OVERSPEED_M_S: Final = 0.5
OVERSPEED: Final = 1.1
OVERSPEED_S: Final = 2.0
"""A gust makes a vehicle no faster than this for so long."""

UNDERSPEED: Final = 0.6
UNDERSPEED_S: Final = 5.0
UNDERSPEED_LEG_M: Final = 10.0
"""A leg of which more than this is left is flown faster than this share, after some seconds."""

# For lag_monitor.py

LAG_HOLD_S: Final = 2.0
"""A program that stood still for so long has the vehicle hold before it goes on: 10 m at 5 m/s were
flown unwatched, more than the clearance of most missions."""

TELEMETRY_GAP_S: Final = 0.5
"""Two telemetries that are farther apart, on the vehicle's clock, have a way between them that was
not checked."""

LAG_RECENT_S: Final = 5.0
"""What is missing so soon after a lag may wait in this program's own sockets: no warning of it."""

LAG_STEP_M: Final = 0.5

# For safety_monitor.py

DISARMED_S: Final = 10.0
"""A landed vehicle of which no HEARTBEAT has come for so long counts as disarmed."""

KILLED_M: Final = 3.0
"""Disarmed in the air lower than this the vehicle has landed, whatever its altitude shows."""

REST_M: Final = 0.5
REST_S: Final = 2.0
"""What fell is down when its altitude has changed by less than this in that time."""

TWINS_S: Final = 5.0
"""Two vehicles under one system id have both reported within so long."""

HOME_MOVED_AGAIN_M: Final = 2.0
"""A home that was commanded to be moved is announced again when it is so much elsewhere."""

PX4_SETS_HOME_S: Final = 5.0
"""PX4 sets home itself at each lift-off, and may without satellites: what shows so soon after that
is no station's doing."""

POSITION_UNKNOWN_S: Final = 2.0
"""It is alarmed of once it was not known for so long where a vehicle is that another flies."""

ALTITUDE_DISAGREES_M: Final = 3.5
ALTITUDE_DISAGREES_HOME_M: Final = 6.0
"""The altitude of a receiver with a fix is good to about 2 m; what is planned, to 5 m."""

ALTITUDE_AVERAGE_S: Final = 4.0
ALTITUDE_SAMPLE_M: Final = 7.0
ALTITUDE_SAMPLE_S: Final = 0.5
"""So far off the average, and for so long, one altitude counts at most. It may be a very wrong
one: that raises the average by less than `ALTITUDE_DISAGREES_M` in the 1.5 s that it
is believed."""

FOREIGN_ORDER_S: Final = 1.5
"""How long an order that is not ours has to show: our own shows late on a slow link."""

ORDER_STALE_S: Final = 5.0
"""What it was commanded to do so long ago says nothing of an order of now."""

OLD_POSITION_S: Final = 2.0
"""A position this old may be the one from before the vehicle braked: its target proves nothing."""

FOREIGN_TARGET_M: Final = 4.0
"""A target so far from ours is not ours; the autopilot's position estimate wanders less."""

BRAKED_S: Final = 3.0
"""After so long in Hold the place that it hovers at is where we stopped it."""

HOVERS_M: Final = 2.0
"""A vehicle that was stopped and is nearer than this to the target that it reports hovers there.

One that is farther off reports the target of before the stop: its stream may be late."""

HOVERS_M_S: Final = 1.0
"""A vehicle that is faster than this has not stopped yet."""

HOLD_STOPS_M: Final = 15.0
"""It stops nearer than this to where it is then; a place farther off is another's order."""

# For standstill.py

MOVED_M: Final = 3.0
"""A vehicle that has come so far, in any direction, has moved: one that hovers wanders by less, and
the slowest landing (0.3 m/s) comes so far in 10 s."""

STANDS_IN_ZONE_S: Final = 15.0
"""To stop takes 4 s, a lost order is given again after 3 s, a way is planned in 2 s, and the first
`MOVED_M` are flown in 2 s: what has not begun to leave a zone after so long will not."""

STANDS_S: Final = 30.0
"""Each wait of a flight that is well ends sooner: a leg that is not followed after 15 s, a jump of
the altitude after 30 s."""

STANDS_FOR_PLAN_S: Final = 90.0
"""A plan is put on board, and read back, within 10 s; over a poor link within a minute."""

SETS_OUT_S: Final = 10.0
"""A vehicle that was kept back moves so soon once it is not: after a fix, which it waits 3 s for, a
leg is planned, commanded and followed."""

STANDSTILL_CHECK_S: Final = 1.0
"""How often a vehicle that does not move is checked."""
