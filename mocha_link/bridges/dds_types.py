"""ROS 2 message types as CycloneDDS wants them, made from their definitions.

A sample is its serialized bytes: DDS learns what the type looks like, so that it can match others,
but nothing is decoded.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cyclonedds.idl import IdlStruct, make_idl_struct, types
from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import FieldDesc

from mocha_link.ros.ros_store import RosTypes, element

_BASES: dict[str, Any] = {"bool": bool, "string": str, "char": types.uint8}  # others by their name


class Sample:
    """The bytes of a message, as the samples of all types."""

    def __init__(self, data: bytes) -> None:
        self.data = data

    def serialize(self, *_: object, **__: object) -> bytes:
        """As DDS wants to have it: as it is."""
        return self.data


def _read(cls: type[Sample], data: bytes, /, *_: object, **__: object) -> Sample:
    return cls(data)


class DdsTypes:
    """Makes the types of topics, once each.

    Args:
        definitions: texts of ``.msg`` files by ``pkg/Type``, besides the standard ones.

    Raises:
        RosError: one of them cannot be used.
    """

    def __init__(self, definitions: Mapping[str, str]) -> None:
        self._types = RosTypes(2, definitions)
        self._structs: dict[str, Any] = {}
        self._roots: dict[str, Any] = {}

    def of(self, kind: str) -> Any:
        """The type of a topic, e.g. for ``geometry_msgs/Pose``. Raises RosError."""
        name = self._types.check(kind)
        if name not in self._roots:
            made: Any = self._made(name)
            made.__init__ = Sample.__init__
            made.serialize = Sample.serialize
            made.deserialize = made.deserialize_key = classmethod(_read)
            self._roots[name] = made
        return self._roots[name]

    def _struct(self, name: str) -> Any:
        if name not in self._structs:
            self._structs[name] = self._made(name)
        return self._structs[name]

    def _made(self, name: str) -> type[IdlStruct]:
        package, _, rest = name.partition("/")
        space, _, short = rest.partition("/")
        fields = {field: self._field(desc) for field, desc in self._types.fields(name)}
        return make_idl_struct(
            short,
            f"{package}.{space}.dds_.{short}_",
            fields or {"structure_needs_at_least_one_member": types.uint8},
            dataclassify=False,
        )

    def _field(self, desc: FieldDesc) -> Any:
        kind, base = element(desc)
        one: Any
        if kind == Nodetype.NAME:
            one = self._struct(base)
        elif base[0] == "string" and base[1]:
            bounded: Any = types.bounded_str
            one = bounded[base[1]]
        else:
            one = _BASES.get(base[0]) or getattr(types, base[0])
        many: Any = types
        if desc[0] == Nodetype.ARRAY:
            return many.array[one, desc[1][1]]
        if desc[0] == Nodetype.SEQUENCE:
            size = desc[1][1]
            return many.sequence[one, size] if size else many.sequence[one]
        return one
