"""PX4's flight modes and their numbers on the wire, and the releases that differ."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Final

CUSTOM_MODE_ENABLED: Final = 1  # MAV_MODE_FLAG
_AUTO_MAIN: Final = 4


class UnsupportedAutoModeError(Exception):
    """A DO_SET_MODE names an AUTO submode that PX4 does not have."""


class FlightMode(Enum):
    """A mode: PX4's main and sub mode, its name in PX4's texts, and flags of HEARTBEAT.base_mode.

    Without those that nothing here flies: Manual, Acro, Stabilized.

    The values are those of px4_custom_mode.h; in HEARTBEAT.custom_mode the main mode is in bits
    16..23 and the submode in bits 24..31.
    """

    ALTCTL = (2, 0, "Altitude", 0x51)
    POSCTL = (3, 0, "Position", 0x51)
    ORBIT = (3, 1, "Orbit", 0x1D)
    AUTO_TAKEOFF = (4, 2, "Takeoff", 0x1D)
    AUTO_LOITER = (4, 3, "Hold", 0x1D)
    AUTO_MISSION = (4, 4, "Mission", 0x1D)
    AUTO_RTL = (4, 5, "Return", 0x1D)
    AUTO_LAND = (4, 6, "Land", 0x1D)
    OFFBOARD = (6, 0, "Offboard", 0x11)
    TERMINATION = (10, 0, "Termination", 0x01)

    __hash__ = object.__hash__  # looked up some hundred times a simulated second

    def __init__(self, main: int, sub: int, label: str, base_mode: int) -> None:
        self.custom_mode = main << 16 | sub << 24
        self.label = label
        self.base_mode = base_mode

    @property
    def prevents_arming(self) -> bool:
        """Whether PX4 refuses to arm in this mode."""
        return self in _PREVENT_ARMING

    @property
    def needs_pilot(self) -> bool:
        """Whether the mode flies on a pilot's sticks."""
        return self in _STICKS


_PREVENT_ARMING: Final = frozenset(
    {FlightMode.AUTO_RTL, FlightMode.AUTO_LAND, FlightMode.TERMINATION}
)
_STICKS: Final = frozenset({FlightMode.ALTCTL, FlightMode.POSCTL})
_BY_NUMBER: Final = {(mode.value[0], mode.value[1]): mode for mode in FlightMode}
_BY_MAIN: Final = {
    main: mode
    for (main, sub), mode in _BY_NUMBER.items()
    if sub == 0 and mode is not FlightMode.TERMINATION
}


def requested_mode(base_mode: int, main: int, sub: int) -> FlightMode | None:
    """The mode that a DO_SET_MODE or SET_MODE asks for; None is PX4's silent "nothing to do".

    Raises:
        UnsupportedAutoModeError: no such AUTO submode.
    """
    if not base_mode & CUSTOM_MODE_ENABLED:
        return FlightMode.AUTO_MISSION if base_mode & 4 else None
    if main != _AUTO_MAIN:
        return _BY_MAIN.get(main)
    if sub == 0:
        return FlightMode.AUTO_MISSION
    try:
        return _BY_NUMBER[(main, sub)]
    except KeyError:
        raise UnsupportedAutoModeError(f"AUTO submode {sub}") from None


@dataclass(frozen=True, slots=True)
class Px4Version:
    """What a release does differently.

    Attributes:
        words: Its number.
        number: AUTOPILOT_VERSION.flight_sw_version.
        answers_modes_twice: DO_SET_MODE is answered ACCEPTED first, and then with what was decided.
        sets_item_by_command: DO_SET_MISSION_CURRENT is known, with a COMMAND_ACK.
    """

    words: str
    number: int
    answers_modes_twice: bool
    sets_item_by_command: bool


_KNOWN: Final = (
    Px4Version("1.17", 0x011100FF, answers_modes_twice=True, sets_item_by_command=False),
    Px4Version("1.18", 0x011200FF, answers_modes_twice=False, sets_item_by_command=True),
)
VERSIONS: Final = tuple(version.words for version in _KNOWN)


def px4_version(words: str) -> Px4Version:
    """A release by its number.

    Raises:
        KeyError: not one of `VERSIONS`.
    """
    return {version.words: version for version in _KNOWN}[words]
