"""The releases of PX4 that the simulated autopilot can behave as, and where they differ."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


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
