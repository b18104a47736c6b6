"""Which params a command or a mission item uses, as PX4 1.18 has it: others have to be 0 or NaN.

PX4 1.18 refuses parameters that it would ignore, so that the sender notices. One in no table here
is not checked, as in PX4.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

from sitl.px4sim.plan_store import FRAME_MISSION, Command

_PLACE: Final = "567"
_UNUSED_WHOLE: Final = frozenset({2**31 - 1, -(2**31)})  # of x and y
_OF_ITEMS: Final[Mapping[int, str]] = {
    Command.NAV_WAYPOINT: f"124{_PLACE}",
    Command.NAV_LOITER_UNLIM: f"34{_PLACE}",
    Command.NAV_RETURN_TO_LAUNCH: "",
    Command.NAV_LAND: f"124{_PLACE}",
    Command.NAV_TAKEOFF: f"14{_PLACE}",
    Command.DO_CHANGE_SPEED: "123",
    Command.FENCE_POLYGON_INCLUSION: "156",
    Command.FENCE_POLYGON_EXCLUSION: "156",
    Command.FENCE_CIRCLE_INCLUSION: "156",
    Command.FENCE_CIRCLE_EXCLUSION: "156",
    Command.RALLY_POINT: _PLACE,
}
_OF_COMMANDS: Final[Mapping[int, str]] = {  # by MAV_CMD
    20: "",
    21: f"124{_PLACE}",
    22: f"14{_PLACE}",
    176: "123",
    178: "123",
    179: f"1234{_PLACE}",
    400: "12",
    420: "123",
}


def unused_param_of_command(command: int, params: Sequence[float]) -> int | None:
    """The first of param1..7 that has a value and means nothing to a MAV_CMD; None: none is."""
    return _first(_OF_COMMANDS.get(command), [not _is_unset(value) for value in params])


def unused_param_of_item(message: Any) -> int | None:
    """The same of an uploaded MISSION_ITEM_INT; its x and y are params 5 and 6."""
    params = (message.param1, message.param2, message.param3, message.param4)
    x, y = (
        value not in _UNUSED_WHOLE and (message.frame != FRAME_MISSION or value != 0)
        for value in (message.x, message.y)
    )
    given = [not _is_unset(value) for value in params]
    return _first(_OF_ITEMS.get(message.command), [*given, x, y, not _is_unset(message.z)])


def _is_unset(value: float) -> bool:
    return math.isnan(value) or value == 0.0


def _first(used: str | None, given: Sequence[bool]) -> int | None:
    if used is None:
        return None
    numbered = enumerate(given, 1)
    return next(
        (number for number, is_given in numbered if is_given and str(number) not in used), None
    )
