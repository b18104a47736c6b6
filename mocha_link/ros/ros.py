"""Typed payloads: ROS messages as ROS 1 bytes, as CDR (ROS 2), as objects and as JSON.

Needs the extra ``ros`` (the package `rosbags`; no ROS). Message objects are those of `rosbags`:
attributes by field name, arrays of numbers as numpy arrays. In JSON a message is an object;
``uint8[]``, ``char[]`` and ``byte[]`` are Base64 text, and a float that is no number is the text
``"nan"``, ``"inf"`` or ``"-inf"``.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from typing import Any

from mocha_link.errors import needs_extra
from mocha_link.team.team import Ros

with needs_extra("what reads ROS messages", "ros"):
    from mocha_link.ros.ros_json import Builder, to_json, translate
    from mocha_link.ros.ros_store import RosError, RosTypes

__all__ = ["RosCodec", "RosError"]


class RosCodec:
    """Reads and writes ROS messages. Any thread may use it.

    It knows the standard types of ROS 1 (Noetic) and ROS 2 (Jazzy) under the names that a team
    file has, e.g. ``geometry_msgs/PoseStamped``, and those of `definitions`.

    Args:
        definitions: texts of ``.msg`` files by ``pkg/Type``; they may use each other.

    Raises:
        RosError: a definition cannot be read. It is what every method raises, and nothing else.
    """

    def __init__(self, definitions: Mapping[str, str] | None = None) -> None:
        self._types = {ros: RosTypes(ros, definitions or {}) for ros in (1, 2)}  # by ROS version

    def knows(self, kind: str, ros: Ros = 1) -> bool:
        """Whether messages of a type can be read and written."""
        return self._types[ros].known(kind)

    def decode(self, kind: str, data: bytes, ros: Ros) -> object:
        """The message object that bytes hold.

        At most 64 MiB and a million messages within a message are read; arrays stay in the bytes.
        """
        return self._types[ros].read(kind, data)

    def encode(self, kind: str, message: object, ros: Ros) -> bytes:
        """The bytes of a message object (of either ROS version) or of plain values, as in JSON."""
        types = self._types[ros]
        name = types.check(kind)
        if isinstance(message, Mapping):
            return types.write(name, self.from_json(kind, message, ros))
        if types.holds(name, message):
            with contextlib.suppress(RosError):  # it may hold messages of the other version
                return types.write(name, message)
        return types.write(name, self._guarded(translate, self._both(kind), types, name, message))

    def convert(self, kind: str, data: bytes, *, from_ros: Ros, to_ros: Ros) -> bytes:
        """The same message in the serialization of the other ROS version."""
        return self.encode(kind, self.decode(kind, data, from_ros), to_ros)

    def to_json(self, kind: str, message: object) -> dict[str, Any]:
        """A message object as plain values that `json.dumps` takes."""
        both = self._both(kind)
        values: dict[str, Any] = self._guarded(to_json, both, both[0].check(kind), message)
        return values

    def from_json(self, kind: str, values: Mapping[str, Any], ros: Ros = 1) -> object:
        """The message object of plain values; a field that is left out is zero or empty."""
        types = self._types[ros]
        return self._guarded(Builder(types).message, types.check(kind), values, kind)

    def definition(self, kind: str) -> tuple[str, str]:
        """The full text of a type as ROS 1 has it, and its MD5 sum."""
        return self._types[1].definition(kind)

    def _both(self, kind: str) -> tuple[RosTypes, ...]:
        """The versions of ROS that have a type."""
        both = tuple(types for types in self._types.values() if types.known(kind))
        if not both:
            self._types[1].check(kind)
        return both

    @staticmethod
    def _guarded(work: Any, *arguments: Any) -> Any:
        try:
            return work(*arguments)
        except (AttributeError, LookupError, TypeError, ValueError, ArithmeticError) as error:
            raise RosError(f"not a message of its type: {error}") from None
