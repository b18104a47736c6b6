"""Typed payloads: ROS messages as ROS 1 bytes, as CDR (ROS 2), as objects and as JSON.

Needs the extra ``ros`` (the package `rosbags`; no ROS). Message objects are those of `rosbags`:
attributes by field name, arrays of numbers as numpy arrays. In JSON a message is an object;
``uint8[]``, ``char[]`` and ``byte[]`` are Base64 text, and a float that is no number is the text
``"nan"``, ``"inf"`` or ``"-inf"``.
"""

from __future__ import annotations

import base64
import contextlib
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from mocha_link.errors import needs_extra
from mocha_link.team import Ros

with needs_extra("what reads ROS messages", "ros"):
    import numpy as np
    from rosbags.interfaces import Nodetype
    from rosbags.interfaces.typing import FieldDesc

    from mocha_link.ros.ros_store import HEADER, MAX_OBJECTS, RosError, RosTypes, attribute, element

__all__ = ["RosCodec", "RosError"]

_OCTETS = ("uint8", "char", "byte")
_DTYPES = {"bool": "bool_", "char": "uint8", "byte": "int8"}
_NO_NUMBERS = {"nan": math.nan, "inf": math.inf, "-inf": -math.inf}
_LARGEST = {"float32": float(np.finfo("float32").max), "float64": sys.float_info.max}
_INSTEAD: dict[str, Any] = {"string": "", "bool": False}  # any other base type: 0


class RosCodec:
    """Decodes and encodes ROS messages. Any thread may use it.

    The codec has the standard types of ROS 1 (Noetic) and ROS 2 (Jazzy) under the names of a team
    file, e.g. ``geometry_msgs/PoseStamped``, and those of `definitions`. Every method raises
    RosError for a message that does not match its type, and no other error.

    Args:
        definitions: texts of ``.msg`` files by ``pkg/Type``; they may use each other.

    Raises:
        RosError: a definition cannot be parsed.
    """

    def __init__(self, definitions: Mapping[str, str] | None = None) -> None:
        self._types = {ros: RosTypes(ros, definitions or {}) for ros in (1, 2)}  # by ROS version

    def knows(self, kind: str, ros: Ros = 1) -> bool:
        """Whether the codec has a type.

        Args:
            kind: the name of the type.
            ros: the ROS version (1 or 2).
        """
        return self._types[ros].known(kind)

    def decode(self, kind: str, data: bytes, ros: Ros) -> Any:
        """Decode a message.

        At most 64 MiB and a million nested messages are decoded. Arrays are views of `data`.

        Args:
            kind: the name of the type.
            data: the serialized message.
            ros: its ROS version.

        Returns:
            The message object.

        Raises:
            RosError: the bytes do not match the type.
        """
        return self._types[ros].read(kind, data)

    def encode(self, kind: str, message: object, ros: Ros) -> bytes:
        """Encode a message.

        Args:
            kind: the name of the type.
            message: a message object of either ROS version, or plain values as in JSON.
            ros: the ROS version of the serialization.

        Returns:
            The serialized message.

        Raises:
            RosError: the message does not match the type.
        """
        types = self._types[ros]
        name = types.check(kind)
        if isinstance(message, Mapping):
            return types.write(name, self.from_json(kind, message, ros))
        if types.holds(name, message):
            with contextlib.suppress(RosError):  # it may hold messages of the other version
                return types.write(name, message)
        return types.write(name, self._guarded(_translate, self._both(kind), types, name, message))

    def convert(self, kind: str, data: bytes, *, from_ros: Ros, to_ros: Ros) -> bytes:
        """Convert a message to the serialization of the other ROS version.

        Args:
            kind: the name of the type.
            data: the serialized message.
            from_ros: its ROS version.
            to_ros: the ROS version of the result.

        Raises:
            RosError: the bytes do not match the type, or the versions have different types of this
                name.
        """
        return self.encode(kind, self.decode(kind, data, from_ros), to_ros)

    def to_json(self, kind: str, message: object) -> dict[str, Any]:
        """Convert a message object to plain values that `json.dumps` accepts.

        Args:
            kind: the name of the type.
            message: a message object of either ROS version.

        Raises:
            RosError: the object does not match the type.
        """
        both = self._both(kind)
        values: dict[str, Any] = self._guarded(_to_json, both, both[0].check(kind), message)
        return values

    def from_json(self, kind: str, values: Mapping[str, Any], ros: Ros = 1) -> object:
        """Build a message object from plain values; a missing field is zero or empty.

        Args:
            kind: the name of the type.
            values: the fields by name.
            ros: the ROS version of the object.

        Raises:
            RosError: a value does not fit its field; the message names the field.
        """
        types = self._types[ros]
        return self._guarded(_Builder(types).message, types.check(kind), values, kind)

    def definition(self, kind: str) -> tuple[str, str]:
        """The definition of a type as ROS 1 has it.

        Args:
            kind: the name of the type.

        Returns:
            The full text with nested types, and its MD5 sum.

        Raises:
            RosError: ROS 1 has no such type.
        """
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


def _to_json(types: Sequence[RosTypes], name: str, message: object) -> dict[str, Any]:
    """A message object of either version of ROS as plain values."""
    form = _form(types, name, message)
    return {
        field: _each(desc, getattr(message, attribute(field)), lambda n, v: _to_json(types, n, v))
        for field, desc in form.fields(name)
    }


def _each(desc: FieldDesc, value: Any, nested: Callable[[str, Any], Any]) -> Any:
    """A value of a field in plain form; `nested` makes that of messages."""
    kind, base = element(desc)
    many = desc[0] in (Nodetype.ARRAY, Nodetype.SEQUENCE)
    if kind == Nodetype.NAME:
        return [nested(base, item) for item in value] if many else nested(base, value)
    if many and base[0] in _OCTETS:
        return base64.b64encode(np.asarray(value).tobytes()).decode()
    plain = np.asarray(value).tolist() if many and base[0] != "string" else value
    if base[0].startswith("float"):
        return [_number(item) for item in plain] if many else _number(plain)
    return list(plain) if many else plain


def _number(value: float) -> float | str:
    return float(value) if math.isfinite(value) else str(float(value))


def _translate(types: Sequence[RosTypes], target: RosTypes, name: str, message: object) -> object:
    """A message object as one of the target's version of ROS.

    Fields may differ in upper and lower case; ``seq`` of a header, which ROS 2 does not have,
    becomes 0. Raises RosError if the two versions have different messages of this name.
    """
    form = _form(types, name, message)
    if form is target and all(element(desc)[0] == Nodetype.BASE for _, desc in form.fields(name)):
        return message
    have = {field.lower(): field for field, _ in form.fields(name)}
    values: dict[str, object] = {}
    for field, desc in target.fields(name):
        if field.lower() not in have:
            if (name, field) != (HEADER, "seq"):
                raise RosError(
                    f"{name} of ROS {form.ros} has no field {field}, ROS {target.ros} has"
                )
            values[field] = 0
            continue
        value: Any = getattr(message, attribute(have[field.lower()]))
        kind, inner = element(desc)
        if kind == Nodetype.NAME and isinstance(value, list):
            value = [_translate(types, target, inner, item) for item in value]
        elif kind == Nodetype.NAME:
            value = _translate(types, target, inner, value)
        values[field] = value
    return target.make(name, values)


def _form(types: Sequence[RosTypes], name: str, message: object) -> RosTypes:
    for form in types:
        if form.holds(name, message):
            return form
    raise RosError(f"a {type(message).__name__} stands where a {name} is wanted")


class _Builder:
    """Makes a message object from plain values; a field that is left out is zero or empty."""

    def __init__(self, types: RosTypes) -> None:
        self._types = types
        self._left = MAX_OBJECTS  # objects it may still make

    def message(self, name: str, values: object, where: str) -> object:
        """A message of a type that has been checked. Raises RosError with the place."""
        self._left -= 1
        if self._left < 0:
            raise RosError(f"more than {MAX_OBJECTS} messages within it")
        if not isinstance(values, Mapping):
            raise RosError(f"{where}: {_shown(values)} stands where an object ({name}) is wanted")
        fields = dict(self._types.fields(name))
        unknown = [str(key) for key in values if key not in fields]
        if unknown:
            raise RosError(f"{where}: {name} has no field '{unknown[0]}'; use {', '.join(fields)}")
        return self._types.make(
            name,
            {field: self._field(desc, values.get(field), f"{where}.{field}")
             for field, desc in fields.items()},
        )  # fmt: skip

    def _field(self, desc: FieldDesc, value: object, where: str) -> object:
        kind, inner = element(desc)
        if desc[0] not in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            if kind == Nodetype.NAME:
                return self.message(inner, {} if value is None else value, where)
            return _scalar(inner[0], _INSTEAD.get(inner[0], 0) if value is None else value, where)
        fixed, size = desc[0] == Nodetype.ARRAY, int(desc[1][1])
        items = self._items(kind, inner, size if fixed else 0, value, where)
        if (len(items) != size) if fixed else (size and len(items) > size):
            raise RosError(f"{where}: {len(items)} elements, not {'' if fixed else '<= '}{size}")
        return items

    def _items(self, kind: int, inner: Any, size: int, value: object, where: str) -> Any:
        """The elements of an array; without a value `size` empty ones."""
        if kind == Nodetype.NAME:
            items = _list([{}] * size if value is None else value, where)
            return [self.message(inner, v, f"{where}[{i}]") for i, v in enumerate(items)]
        base = inner[0]
        dtype = _DTYPES.get(base, base)
        if base in _OCTETS and isinstance(value, str):
            try:
                octets = base64.b64decode(value, validate=True)
            except ValueError:
                raise RosError(f"{where}: not Base64 text") from None
            return np.frombuffer(octets, dtype=dtype)
        if isinstance(value, np.ndarray):
            if base != "string" and value.ndim == 1 and value.dtype == dtype:
                return np.ascontiguousarray(value)
            value = value.tolist()
        instead = [_INSTEAD.get(base, 0)] * size
        items = _list(instead if value is None else value, where)
        plain = [_scalar(base, item, f"{where}[{i}]") for i, item in enumerate(items)]
        return plain if base == "string" else np.array(plain, dtype=dtype)


def _list(value: object, where: str) -> list[Any]:
    if not isinstance(value, list | tuple):
        raise RosError(f"{where}: {_shown(value)} stands where a list is wanted")
    return list(value)


def _scalar(base: str, value: object, where: str) -> Any:
    value = value.item() if isinstance(value, np.generic) else value
    if isinstance(value, str) and base.startswith("float"):
        value = _NO_NUMBERS.get(value, value)
    if not _fits(base, value):
        raise RosError(f"{where}: {_shown(value)} stands where a {base} is wanted")
    return value


def _fits(base: str, value: object) -> bool:
    if base in ("string", "bool"):
        return isinstance(value, str if base == "string" else bool)
    if base.startswith("float"):
        if isinstance(value, bool) or not isinstance(value, int | float):
            return False
        odd = isinstance(value, float) and not math.isfinite(value)
        return odd or abs(value) <= _LARGEST[base]
    limits = np.iinfo(_DTYPES.get(base, base))
    return type(value) is int and limits.min <= value <= limits.max


def _shown(value: object) -> str:
    if isinstance(value, str):
        return f"text '{value[:40]}'"
    if isinstance(value, Mapping | list | tuple):
        return "an object" if isinstance(value, Mapping) else "a list"
    return str(value)[:40]
