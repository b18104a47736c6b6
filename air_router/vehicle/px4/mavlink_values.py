"""Values defined by MAVLink and PX4: commands, message ids, flags, frame sizes.

They are not tunable. Enumerations use the names of common.xml.
"""

from enum import IntEnum
from typing import Final


class MavCmd(IntEnum):
    """MAV_CMD."""

    NAV_LAND = 21
    DO_SET_MODE = 176
    DO_CHANGE_SPEED = 178
    DO_REPOSITION = 192
    COMPONENT_ARM_DISARM = 400
    RUN_PREARM_CHECKS = 401  # PX4 sends its health and arming report again
    SET_MESSAGE_INTERVAL = 511
    REQUEST_MESSAGE = 512


class MessageId(IntEnum):
    """Message ids."""

    HEARTBEAT = 0
    SYS_STATUS = 1
    GPS_RAW_INT = 24
    GLOBAL_POSITION_INT = 33
    MISSION_CURRENT = 42
    POSITION_TARGET_GLOBAL_INT = 87
    RADIO_STATUS = 109
    AUTOPILOT_VERSION = 148
    WIND_COV = 231
    HOME_POSITION = 242
    EXTENDED_SYS_STATE = 245
    FLIGHT_INFORMATION = 264


# MAV_COMPONENT

AUTOPILOT: Final = 1  # MAV_COMP_ID_AUTOPILOT1
COMPANION_COMPONENT: Final = 191  # MAV_COMP_ID_ONBOARD_COMPUTER

# HEARTBEAT, CURRENT_MODE, EXTENDED_SYS_STATE

ARMED: Final = 128  # MAV_MODE_FLAG_SAFETY_ARMED
CUSTOM_MODE: Final = 1.0  # MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
MAIN_AUTO: Final = 4  # PX4_CUSTOM_MAIN_MODE_AUTO
CRITICAL: Final = 5  # MAV_STATE_CRITICAL: a failsafe acts
TERMINATED: Final = 8  # MAV_STATE_FLIGHT_TERMINATION: or a kill switch
ON_GROUND: Final = 1  # MAV_LANDED_STATE
PREARM_GOOD: Final = 0x10000000  # MAV_SYS_STATUS_PREARM_CHECK

# Fields

UNKNOWN_16: Final = 65535  # unknown, in a 16-bit field
BOOT_CLOCK_MS: Final = 2**32  # where time_boot_ms wraps
STATUSTEXT_BYTES: Final = 50
INT32, REAL32 = 6, 9  # MAV_PARAM_TYPE; PX4 has no others
NO_SUCH_PARAMETER: Final = 1  # MAV_PARAM_ERROR_DOES_NOT_EXIST
GROUND_SPEED: Final = 1.0  # SPEED_TYPE
GLOBAL_INT: Final = 5  # MAV_FRAME; PX4 takes the altitude as AMSL in every frame
NOWHERE: Final = 2**31 - 1  # in place of a latitude or longitude

# Plans

MISSION, FENCE, RALLY = 0, 1, 2  # MAV_MISSION_TYPE
MISSION_UNKNOWN: Final = 0  # MISSION_STATE_UNKNOWN: it is not reported, as before PX4 1.17
MISSION_INVALID: Final = 1  # MISSION_STATE_NO_MISSION: none on board, or none that can be flown
MISSION_ACCEPTED: Final = 0  # MAV_MISSION_RESULT: stored, or cleared

# Events of PX4 (libevents)

EVENT_ERROR: Final = 3
EVENT_WARNING: Final = 4  # of the levels; those above INFO, 6, are for programs
EVENT_AUTOPILOT: Final = 1 << 24  # component of an event id
FNV_OFFSET, FNV_PRIME = 0x811C9DC5, 0x01000193  # FNV-1a of 32 bits: the hash of an event's name
MISSION_MODE_BIT: Final = 1 << 3  # NAVIGATION_STATE_AUTO_MISSION

# Frames

MAVLINK_1: Final = 0xFE  # how a frame begins
MAVLINK_2: Final = 0xFD
SHORTEST_1_BYTES, SHORTEST_2_BYTES = 8, 12  # frames without payload and signature
SIGNED: Final = 0x01  # of the incompatibility flags, the third byte of a MAVLink 2 frame
SIGNATURE_BYTES: Final = 13  # link id, timestamp (6), SHA-256 (6)
SIGNATURE_HASH_BYTES: Final = 6  # of the SHA-256 that are sent
KEY_BYTES: Final = 32
SIGNING_UNIT_S: Final = 1e-5  # of the timestamps
SIGNING_EPOCH_UNIX_S: Final = 1_420_070_400  # 2015-01-01, when they begin
LAST_TIMESTAMP: Final = 1 << 47
"""Last valid timestamp, in 2059: half of the range of 6 bytes, so none overflows."""

SO_RCVBUFFORCE: Final = 33  # of Linux, which Python's socket does not name; needs CAP_NET_ADMIN
