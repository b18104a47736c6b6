"""Numbers that tune this room: each with its unit, and why it is what it is.

Rates of PX4's messages are those of its MAVLink mode "Onboard".
"""

from collections.abc import Mapping
from typing import Final

# For boot_clock.py

BOOT_CLOCK_WRAPS_WITHIN_MS: Final = 120_000
"""A clock this close to its end that then shows a small time has wrapped. A vehicle silent for half
of this is lost, and only a restart shows such a small time otherwise."""

TWIN_CLOCKS_APART_S: Final = 15.0
"""A time farther from a clock than this belongs to another clock: one vehicle's streams are late by
less, and messages kept in a socket do not alternate with new ones."""

TWIN_TURNS: Final = 4
TWIN_TURNS_WINDOW: Final = 60
"""Two clocks that alternate this often among the latest messages belong to two vehicles."""

TWIN_CLEARED_MESSAGES: Final = 100
"""Messages without the other clock until it counts as gone: ten seconds of positions, at 10 Hz."""

# For direct_link.py

TCP_CONNECT_S: Final = 3.0
"""Wall-clock limit for a TCP server to answer: a lost SYN is repeated after 1 s."""

LINE_REOPENED_S: Final = 1.0
"""Interval of attempts to reopen a lost serial line, without a busy loop."""

SERIAL_BAUD: Final = 57600
"""Default rate of a serial line: that of MAVSDK and of telemetry radios."""

READ_BYTES: Final = 65535
"""Size of a read: no datagram is larger."""

# For key_provisioning.py

KEY_STORED_S: Final = 1.0
"""How long the link stays open after a key was sent, until PX4's other links have read it."""

KEY_RESPONSE_S: Final = 5.0
"""Wall-clock limit for a HEARTBEAT, sent at 1 Hz, and for the answer to a command."""

# For mavlink_signing.py

SIGNING_NEW_SENDER_S: Final = 60.0
"""The first timestamp of a sender may be older than ours by this, as in MAVLink's signing guide."""

SIGNING_LINK_ID: Final = 1
"""Link id of our signatures. It never changes, because PX4 remembers only 16 senders until it
restarts, and counts each link of each sender."""

SIGNING_RESERVED_S: Final = 30.0
"""How far the stored timestamp is ahead, so it is not written with every message."""

SIGNING_REWRITTEN_S: Final = 10.0
"""It is written again this long before it is reached, for a slow disk."""

# For px4.py

FIRST_POSITIONS_S: Final = 4.0
"""Wall-clock limit for positions, which are sent tens of times a second."""

ARMING_HEALTH_S: Final = 60.0
"""Wall-clock limit for PX4's health checks before arming: an estimator that has just started takes
some tens of seconds."""

SPOOFED_MESSAGES: Final = 3
"""This many messages with a wrong signature come from another sender; fewer may be noise on a
serial line."""

LINK_SILENT_S: Final = 3.0
"""Wall-clock time without a message after which a vehicle counts as silent: three HEARTBEATs."""

LINK_SILENT_CHECKS: Final = 3
"""Checks of the link within that time: silence is reported late by a third at most."""

# For px4_commands.py

ORDER_CONFIRM_S: Final = 3.0
"""Wall-clock limit for a command's confirmation: a mode is reported with the next HEARTBEAT, at 1
Hz."""

ORDER_SETTLED_S: Final = 1.0
"""A HEARTBEAT received this long after a command should show its effect."""

HEARTBEAT_FRESH_S: Final = 0.5
"""A command is repeated only this soon after the HEARTBEAT that allows it: half of its interval."""

ACK_LATE_S: Final = 10.0
"""An acknowledgement may belong to an earlier command for this long."""

ORDER_LONGEST_S: Final = 15.0
"""Longest wait for a vehicle that keeps reporting a command as in progress."""

MODE_FRESH_S: Final = 0.02
"""A received mode allows a command for this long; later it is requested again."""

MODE_POLL_S: Final = 0.1
"""Interval of requests for the mode during a wait; HEARTBEAT is sent at 1 Hz."""

ORDER_ACTS_S: Final = 0.2
"""Vehicle's time after an acknowledgement by which the mode has changed; measured: within 20 ms.
A simulation, or a computer under load, may run slower than our own clock."""

SAME_TARGET_M: Final = 1.0
"""A target nearer to a place than this is that place: PX4 reports it to a centimeter."""

# For px4_connection.py

FIND_S: Final = 5.0
"""Wall-clock limit for the first heartbeat: an autopilot sends one every second."""

FIND_OTHERS_S: Final = 1.5
"""If several vehicles send to one port: time for a HEARTBEAT of the requested one."""

FIND_ELSEWHERE_S: Final = 1.5
"""How long other ports are checked at the end if nothing is received: one HEARTBEAT."""

FIND_POLL_S: Final = 0.05
"""Interval of checks for the requested vehicle among those that MAVSDK has found."""

FIND_DATAGRAMS: Final = 100
"""Datagrams checked per port: a busy other sender must not block the search."""

# For px4_link.py

PEER_PORT_ANEW_S: Final = 5.0
"""A peer silent for this long may come back on another port of the same host."""

SOCKET_BUFFER_S: Final = 20.0
"""Messages of a full link kept while this program stalls, as far as the kernel allows."""

LINK_DATAGRAMS_HZ: Final = 410
"""Datagrams of a PX4 1.17 on its companion's link, as measured."""

DATAGRAM_BUFFER_BYTES: Final = 832
"""Buffer space that Linux counts for one of them: 256 fill its default of 212992."""

# For px4_messages.py

TEXTS_KEPT: Final = 3
"""Number of PX4's latest texts added to an error: a refusal has a line or two."""

LINK_GAP_S: Final = 0.2
"""After a longer gap the first messages may be old, if this program stalled, and a pilot may have
chosen another mode meanwhile."""

LINK_PAUSE_S: Final = 1.5
"""A longer gap may always be a stall of this program. Slow links have shorter ones."""

BACKLOG_S: Final = 0.5
"""Time after a gap, on our clock, during which messages without the vehicle's time are ignored."""

BACKLOG_CAUGHT_UP: Final = 0.97
BACKLOG_JITTER_S: Final = 0.15
"""A message is current if the vehicle's time has advanced by this share of ours, minus a radio's
jitter between two messages."""

BACKLOG_LIVE: Final = 0.7
"""Messages that arrive at this share of their own time span come over a link that has slowed
down."""

# For px4_mode_check.py

MODE_RESPONSE_S: Final = 3.0
"""Wall-clock limit for the answer: PX4 takes 15 ms, a slow radio a second."""

MODE_REQUESTED_AGAIN_S: Final = 0.25
"""Interval of repeated requests until one is answered."""

STOOD_STILL_CHECK_S: Final = 0.05
"""Interval of checks for a stall of this program since the request: well below `LINK_GAP_S`."""

# For px4_motions.py

ORDER_ATTEMPTS: Final = 4
"""Most transmissions of a command without a destination, while no other command takes effect: a
link that loses every other message loses all four in 6 % of the cases."""

ORDER_DONE_S: Final = 0.2
"""Time after its acknowledgement by which telemetry shows a command."""

STOP_TARGET_M: Final = 5.0
"""A new target nearer than this is a stop: braking from 5 m/s takes 4 m."""

# For px4_plan.py

PLAN_TRANSFER_S: Final = 30.0
"""Wall-clock limit for one transfer, over a slow telemetry radio."""

PLAN_FEASIBLE_S: Final = 5.0
"""Wall-clock limit for PX4's feasibility check of a mission: it takes less than a second."""

PLAN_CHECKS_S: Final = 15.0
"""Wall-clock limit for PX4's arming checks to report a feasible mission."""

PLAN_RELOAD_S: Final = 6.0
"""Vehicle time after which the arming checks concern the new plan: PX4 1.15 and 1.16 check a
mission five seconds after a transfer."""

PLAN_CHECKS_AGAIN_S: Final = 0.5
"""Pause before PX4's checks are requested again after a report without a feasible mission."""

PLAN_BUSY_ATTEMPTS: Final = 3
PLAN_BUSY_S: Final = 5.5
"""PX4 ignores uploads for five seconds after an unfinished transfer
(MAVLINK_MISSION_PROTOCOL_TIMEOUT_DEFAULT); another ground station may begin one meanwhile."""

PLAN_REPORTED_S: Final = 5.0
"""Wall-clock limit for PX4's report of the plan on board, sent once a second."""

# For px4_reports.py

GPS_HEIGHT_S: Final = 1.5
"""An older receiver altitude is not used: the vehicle may climb."""

SURELY_FLIES_M: Final = 15.0
"""A single HEARTBEAT that reports disarmed above this altitude must be confirmed by another."""

# For px4_requests.py

STREAM_RATES_HZ: Final[Mapping[str, float]] = {
    "GLOBAL_POSITION_INT": 10.0,
    "POSITION_TARGET_GLOBAL_INT": 2.0,
    "GPS_RAW_INT": 2.0,
    "WIND_COV": 1.0,
}
"""Requested rates of frequent messages, to limit the load of reading them."""

FIRST_RESPONSE_S: Final = 1.5
"""Wall-clock limit for optional data requested at the beginning."""

STREAM_MISSING_S: Final = 2.0
STREAM_REQUESTED_EVERY_S: Final = 5.0
"""A stream that is missing for this long while others are received is requested again, at this
interval on our clock: another program on this link may have turned it off. Most streams are sent
once a second."""

INSPECTION_HEALTH_S: Final = 4.0
"""Wall-clock limit for a vehicle that was just switched on to become healthy."""

ARMING_REPORT_S: Final = 1.0
"""Wall-clock limit for a requested health and arming report."""

PARAMETER_RESPONSE_S: Final = 0.5
PARAMETER_ATTEMPTS: Final = 5
"""Wall-clock time per attempt, and number of attempts, for parameters requested together. MAVSDK
would wait three seconds for each parameter that PX4 does not have."""

PARAMETERS_ABSENT: Final = 0.25
PARAMETERS_ABSENT_ATTEMPTS: Final = 2
"""If less than this share is missing after this many attempts, PX4 does not have these parameters:
before 1.18 it does not answer such requests."""

FLIGHT_INFORMATION_ATTEMPTS: Final = 5
"""Attempts to request the take-off time of a vehicle in the air: a lost datagram must not cost the
flight its duration."""

# For px4_streams.py

MODE_SETTLED_S: Final = 1.5
"""After this long, on our clock, a mode counts without HEARTBEAT, which is sent once a second."""

STREAM_PAUSE_S: Final = 1.0
"""A pause of all streams counts as this long at most: no single stream is missing then."""

MOVING_CM_S: Final = 100
"""At this speed consecutive positions, reported to a centimeter, always differ."""

POSITION_LATE_MS: Final = 1000
"""A position older than the last one by up to this is late; an older one is from another boot."""

FLYING_M: Final = 5.0
"""An armed vehicle that moves at this altitude above home is not on the ground."""

POSITION_BACK_S: Final = 1.0
"""Messages may overtake each other by this, on the vehicle's clock."""

POSITION_AHEAD_S: Final = 4.0
"""Largest step of the vehicle's clock between two messages; more in a fast simulation.

Smaller than a step back that counts as a restart (`VEHICLE_RESTART_S` in flight/limits.py).
"""

POSITION_JUMP_M: Final = 5.0
POSITION_SPEED_M_S: Final = 50.0
"""Largest plausible distance between two messages: a jump of the estimate, plus the flown
distance."""

POSITIONS_AGREEING: Final = 5
POSITIONS_QUIET_S: Final = 0.7
"""This many consistent messages are accepted if nothing else was received for this long."""

# For px4_telemetry.py

LIFTED_M: Final = 2.0
"""A vehicle that climbs this high has lifted off, whatever its landed state; a falling one has not
landed."""

SYSTEM_TIME_NEAR_S: Final = 2.0
"""SYSTEM_TIME within this of the positions' clock keeps that clock running while positions are
missing."""

TELEMETRY_EVERY_S: Final = 0.5
"""Interval, in vehicle time, of telemetry without new positions: ages grow."""

# For signing_key.py

KEY_FILE_BYTES: Final = 4096
"""Bytes read of a key file; a key is shorter, but a wrong file may be large."""
