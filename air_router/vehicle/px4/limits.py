"""Numbers that tune this room: each with its unit, and why it is what it is.

Rates of a PX4's messages are those of its MAVLink mode "Onboard".
"""

from collections.abc import Mapping
from typing import Final

# For boot_clock.py

BOOT_CLOCK_WRAPS_WITHIN_MS: Final = 120_000
"""A clock that was so near its end, and has gone on by no more, has wrapped. A vehicle that was
silent for half of that is lost, and what restarts reports a time that is as small only then."""

TWIN_CLOCKS_APART_S: Final = 15.0
"""A message that is farther off what a clock should show is of another: the streams of one vehicle
are late by less, and what a socket has kept does not take turns with what is new."""

TWIN_TURNS: Final = 4
TWIN_TURNS_WINDOW: Final = 60
"""Two clocks that have taken so many turns among the latest messages are two vehicles'."""

TWIN_CLEARED_MESSAGES: Final = 100
"""The other is lost after so many messages without it: ten seconds of positions, at 10 Hz."""

# For direct_link.py

TCP_CONNECT_S: Final = 3.0
"""Wall-clock limit for a TCP server to answer: a SYN that is lost leaves again after 1 s."""

LINE_REOPENED_S: Final = 1.0
"""How often a line that was lost is opened again: a plug that is put back is no busy loop."""

SERIAL_BAUD: Final = 57600
"""Of a serial line whose address names none: MAVSDK's default, and that of telemetry radios."""

READ_BYTES: Final = 65535
"""What is read at once: no datagram is larger."""

# For key_provisioning.py

KEY_STORED_S: Final = 1.0
"""How long the link is kept that a key left by, until PX4's other links have read it."""

KEY_RESPONSE_S: Final = 5.0
"""Wall-clock limit for a HEARTBEAT, which comes at 1 Hz, and for the answer to a command."""

# For mavlink_signing.py

SIGNING_NEW_SENDER_S: Final = 60.0
"""So much older than ours the first timestamp of a sender may be: as in MAVLink's signing guide."""

SIGNING_LINK_ID: Final = 1
"""Of our signatures: the same at all times, for PX4 remembers no more than 16 senders until it
restarts, each link of each as one."""

SIGNING_RESERVED_S: Final = 30.0
"""So far ahead the stored timestamp is, that it is not written with each message."""

SIGNING_REWRITTEN_S: Final = 10.0
"""It is written again so long before it is reached: a slow disk has the time."""

# For px4.py

FIRST_POSITIONS_S: Final = 4.0
"""Wall-clock limit for positions, which come tens of times a second."""

ARMING_HEALTH_S: Final = 60.0
"""Wall-clock limit for its health checks to pass before arming: an estimator that has
just started takes some tens of seconds."""

SPOOFED_MESSAGES: Final = 3
"""So many messages with a wrong signature are another sender's; fewer may be noise on a serial
line."""

# For px4_commands.py

ORDER_CONFIRM_S: Final = 3.0
"""Wall-clock limit for a command to show: modes appear with the next HEARTBEAT, at 1 Hz."""

ORDER_SETTLED_S: Final = 1.0
"""A HEARTBEAT that comes so long after a command left should show it."""

HEARTBEAT_FRESH_S: Final = 0.5
"""A command leaves again so shortly after the HEARTBEAT that allows it: half of its interval."""

ACK_LATE_S: Final = 10.0
"""For so long an acknowledgement may be that of a command from before."""

ORDER_LONGEST_S: Final = 15.0
"""A vehicle that says again and again that it is about it is waited for no longer."""

MODE_FRESH_S: Final = 0.02
"""A command leaves so shortly after the vehicle's mode was received; later, anew."""

MODE_POLL_S: Final = 0.1
"""How often the vehicle's mode is requested while it is waited for; HEARTBEAT comes at 1 Hz."""

ORDER_ACTS_S: Final = 0.2
"""Vehicle's time after its acknowledgement by which the mode of an order shows: PX4 changes it
within 20 ms. Not our time: a simulation, or a computer under load, may run slower."""

SAME_TARGET_M: Final = 1.0
"""A target nearer than this to a place is that place: PX4 reports it to a centimetre."""

# For px4_connection.py

FIND_S: Final = 5.0
"""Wall-clock limit for the first heartbeat: an autopilot sends one every second."""

FIND_OTHERS_S: Final = 1.5
"""Where several vehicles send to one port: time for a HEARTBEAT of the wanted one as well."""

FIND_ELSEWHERE_S: Final = 1.5
"""For how long other ports are listened on, at last, when nothing is received: one HEARTBEAT."""

FIND_POLL_S: Final = 0.05
"""How often the program checks whether the wanted vehicle is among those that MAVSDK has found."""

FIND_DATAGRAMS: Final = 100
"""So many datagrams of a port are checked: a busy stranger must not keep the search."""

# For px4_link.py

PEER_PORT_ANEW_S: Final = 5.0
"""A peer that was silent for so long may come back on another port of the same host."""

SOCKET_BUFFER_S: Final = 20.0
"""For so long a full link is kept while this program stands still, where the kernel allows it."""

LINK_DATAGRAMS_HZ: Final = 410
"""Datagrams of a PX4 1.17 on its companion's link, as measured."""

DATAGRAM_BUFFER_BYTES: Final = 832
"""What Linux counts for one of them: 256 fill its default of 212992."""

# For px4_messages.py

LINK_SILENT_S: Final = 3.0
"""A vehicle that is silent for so long, wall-clock time, counts as silent: three HEARTBEATs."""

LINK_SILENT_CHECKS: Final = 3
"""How often within that time the link is checked: silence is reported late by a third at most."""

TEXTS_KEPT: Final = 3
"""So many of PX4's latest texts are added to an error: a refusal has a line or two."""

LINK_GAP_S: Final = 0.2
"""After a longer gap in what comes the first messages may be of its beginning, if this program
stood still, and a pilot may have chosen another mode in it."""

LINK_PAUSE_S: Final = 1.5
"""A gap that is longer may always be ours. Slow links have shorter ones."""

BACKLOG_S: Final = 0.5
"""For so long, on our clock, messages after a gap are left out where they do not carry the
vehicle's time."""

BACKLOG_CAUGHT_UP: Final = 0.97
BACKLOG_JITTER_S: Final = 0.15
"""A message is of now if the vehicle's time has gone on by so much of ours, less what a radio may
take longer for one message than for the one before."""

BACKLOG_LIVE: Final = 0.7
"""Messages that take so much of the time that they report come from a link that is slower now."""

# For px4_mode_check.py

MODE_RESPONSE_S: Final = 3.0
"""Wall-clock limit for the answer: a PX4 answers within 15 ms, a slow radio within a second."""

MODE_REQUESTED_AGAIN_S: Final = 0.25
"""How often the request leaves, until one is answered: one that is lost costs no more."""

STOOD_STILL_CHECK_S: Final = 0.05
"""How often the program checks whether this program stood still since the request: well within
`LINK_GAP_S`."""

# For px4_motions.py

ORDER_ATTEMPTS: Final = 4
"""How often an order that leads to no place leaves at most, while no other order comes: of four, a
link that loses every other message loses all in 6 % of the cases."""

ORDER_DONE_S: Final = 0.2
"""So long after its acknowledgement an order shows in what the vehicle says."""

STOP_TARGET_M: Final = 5.0
"""A vehicle whose new target is nearer than this stops there: from 5 m/s braking takes 4 m."""

# For px4_plan.py

PLAN_TRANSFER_S: Final = 30.0
"""Wall-clock limit for one transfer; a slow telemetry radio takes its time."""

PLAN_FEASIBLE_S: Final = 5.0
"""Wall-clock limit for PX4 to judge a mission: it does within a second."""

PLAN_CHECKS_S: Final = 15.0
"""Wall-clock limit for its arming checks to report that a mission can be flown."""

PLAN_RELOAD_S: Final = 6.0
"""Vehicle's time after which its arming checks are of what is on board now: PX4 1.15 and 1.16 judge
a mission five seconds after a transfer."""

PLAN_CHECKS_AGAIN_S: Final = 0.5
"""So long after a report without a feasible mission PX4 is asked to check anew."""

PLAN_BUSY_ATTEMPTS: Final = 3
PLAN_BUSY_S: Final = 5.5
"""PX4 ignores uploads for five seconds after a transfer that was not finished
(MAVLINK_MISSION_PROTOCOL_TIMEOUT_DEFAULT); another ground station may begin one meanwhile."""

PLAN_REPORTED_S: Final = 5.0
"""Wall-clock limit for PX4 to say which plan is on board, which it does once a second."""

# For px4_requests.py

STREAM_RATES_HZ: Final[Mapping[str, float]] = {
    "GLOBAL_POSITION_INT": 10.0,
    "POSITION_TARGET_GLOBAL_INT": 2.0,
    "GPS_RAW_INT": 2.0,
    "WIND_COV": 1.0,
}
"""How often we want what PX4 sends so often that reading it takes our time."""

FIRST_RESPONSE_S: Final = 1.5
"""Wall-clock limit for what is requested at the beginning, and can be done without."""

STREAM_MISSING_S: Final = 2.0
STREAM_REQUESTED_EVERY_S: Final = 5.0
"""A stream that is missing for so long, while others come, is requested, and again so often on our
clock: it was turned off, perhaps, by another program on this link. Most come once a second."""

INSPECTION_HEALTH_S: Final = 4.0
"""Wall-clock time for a vehicle that was just switched on to become healthy."""

ARMING_REPORT_S: Final = 1.0
"""Wall-clock limit for the health and arming report, once it was requested."""

PARAMETER_RESPONSE_S: Final = 0.5
PARAMETER_ATTEMPTS: Final = 5
"""Wall-clock time for what was requested at once, and how often what is missing is requested again.
MAVSDK would wait three seconds for each that PX4 does not have."""

PARAMETERS_ABSENT: Final = 0.25
PARAMETERS_ABSENT_ATTEMPTS: Final = 2
"""Where less than this share is missing after so many attempts, PX4 does not have these: before
1.18 it answers nothing for what it does not have."""

FLIGHT_INFORMATION_ATTEMPTS: Final = 5
"""How often a vehicle in the air is asked since when it flies: one lost datagram must not cost the
flight its duration."""

# For px4_streams.py

MODE_SETTLED_S: Final = 1.5
"""After so long on our clock a mode counts by itself: HEARTBEAT comes once a second."""

STREAM_PAUSE_S: Final = 1.0
"""A pause of all streams counts as no longer: none of them is missing alone then."""

MOVING_CM_S: Final = 100
"""From here on a position, reported to a centimetre, differs from the one before."""

POSITION_LATE_MS: Final = 1000
"""A position from so long before the last one is late; from longer before, of another boot."""

FLYING_M: Final = 5.0
"""What is armed and moves at this altitude above home is not on the ground."""

LIFTED_M: Final = 2.0
"""What climbs so high has lifted off, whatever its landed state says; what falls is not down."""

POSITION_BACK_S: Final = 1.0
"""So far back messages may overtake each other, on the vehicle's clock."""

POSITION_AHEAD_S: Final = 4.0
"""So far the vehicle's clock may step on between two messages; more in a fast simulation.

Less than a step back that counts as a restart (`VEHICLE_RESTART_S` of the flight).
"""

POSITION_JUMP_M: Final = 5.0
POSITION_SPEED_M_S: Final = 50.0
"""How far it may be from one message to the next: what an estimate may jump, and what it flies."""

POSITIONS_AGREEING: Final = 5
POSITIONS_QUIET_S: Final = 0.7
"""So many messages that agree are believed, when for so long nothing else was received."""

# For px4_telemetry.py

GPS_HEIGHT_S: Final = 1.5
"""A receiver's altitude from longer ago says nothing of a vehicle that climbs."""

SYSTEM_TIME_NEAR_S: Final = 2.0
"""Near the clock that positions show, SYSTEM_TIME keeps it going where they are missing."""

SURELY_FLIES_M: Final = 15.0
"""What says once, at such a height, that it is disarmed, is waited for once more."""

TELEMETRY_EVERY_S: Final = 0.5
"""How often, in the vehicle's time, telemetry is passed on while no position comes: ages grow."""

# For signing_key.py

KEY_FILE_BYTES: Final = 4096
"""What is read of a file; a key is shorter, and what is named by mistake may be large."""
