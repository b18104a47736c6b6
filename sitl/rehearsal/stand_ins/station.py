"""A ground station, and the transmitter of its pilot."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

from sitl.mavlink.codec import MessagePacker
from sitl.px4sim.state import FlightMode

GROUND_CONTROL: Final = 190
_SET_MODE, _CHANGE_SPEED, _SET_HOME, _ARM_DISARM = 176, 178, 179, 400  # MAV_CMD
_FORCED: Final = 21196.0
_REAL32: Final = 9  # MAV_PARAM_TYPE

Send = Callable[[MessagePacker, str, Mapping[str, Any]], object]
"""Takes a message: who says it, its name and its fields."""


class Station:
    """A ground station with a pilot's transmitter.

    Args:
        system: Its system id.
        send: Takes every message that it sends to the vehicle.
    """

    def __init__(self, system: int, send: Send) -> None:
        self._sender = MessagePacker(system, GROUND_CONTROL)
        self._send = send

    def say(self, name: str, **fields: Any) -> None:
        """Send a message to the vehicle; fields that are not given are 0."""
        self._send(self._sender, name, self._sender.addressed(name, 1, fields))

    def command(self, number: int, *params: float) -> None:
        """A COMMAND_LONG."""
        fields = {f"param{n}": value for n, value in enumerate(params, start=1)}
        self.say("COMMAND_LONG", command=number, **fields)

    def choose(self, mode: FlightMode) -> None:
        """DO_SET_MODE."""
        self.command(_SET_MODE, 1.0, *mode.value[:2])

    def disarm(self, *, forced: bool) -> None:
        """As it is: refused in the air, unless it is forced."""
        self.command(_ARM_DISARM, 0.0, _FORCED if forced else 0.0)

    def change_speed(self, speed_m_s: float) -> None:
        """DO_CHANGE_SPEED over ground."""
        self.command(_CHANGE_SPEED, 1.0, speed_m_s, -1.0)

    def move_home(self, latitude_deg: float, longitude_deg: float, amsl_m: float) -> None:
        """DO_SET_HOME to a place."""
        place = {"x": latitude_deg * 1e7, "y": longitude_deg * 1e7, "z": amsl_m, "frame": 5}
        self.say("COMMAND_INT", command=_SET_HOME, **place)

    def sticks(self, pitch: float = 0.0, roll: float = 0.0) -> None:
        """The transmitter says where its sticks are, -1 to 1; throttle in the middle."""
        self.say("MANUAL_CONTROL", x=pitch * 1000, y=roll * 1000, z=500)

    def set_parameter(self, name: str, value: float) -> None:
        """PARAM_SET of a real number."""
        self.say("PARAM_SET", param_id=name, param_value=value, param_type=_REAL32)
