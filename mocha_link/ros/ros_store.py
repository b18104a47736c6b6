"""ROS message types of one ROS version: the standard ones and those that a team brings along.

Built on `rosbags` (extra ``ros``): it holds the standard types, parses ``.msg`` texts and makes
serializers. What is added here is that nothing hostile gets past: types are checked before code is
made for them, and one message may not become more than MAX_OBJECTS objects.
"""

from __future__ import annotations

import dataclasses
import keyword
import struct
import threading
from collections.abc import Iterator, Mapping
from typing import Any, cast

from rosbags.interfaces import Msgdef, Nodetype
from rosbags.interfaces.typing import FieldDesc
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from mocha_link.errors import MochaLinkError
from mocha_link.store import MAX_BYTES

MAX_OBJECTS = 1_000_000  # nested messages in one message
MAX_ARRAY = 1024  # fixed arrays of texts or messages: code is made for every element
MAX_DEPTH = 32  # of messages within messages
FILLER = "structure_needs_at_least_one_member"
HEADER = "std_msgs/msg/Header"

_STANDARD = {1: Stores.ROS1_NOETIC, 2: Stores.ROS2_JAZZY}
# What the generated code raises for bytes or values that do not fit, besides its own errors.
_MISFITS = (
    SerdeError,
    struct.error,
    ArithmeticError,
    AssertionError,
    AttributeError,
    LookupError,
    TypeError,
    ValueError,
)
_registering = threading.Lock()  # rosbags makes every user's types in one module


class RosError(MochaLinkError):
    """A type that is not known, or bytes or values that are not a message of their type."""


def long_name(name: str) -> str:
    """``pkg/Type`` as ``pkg/msg/Type``."""
    package, _, rest = name.partition("/")
    return name if "/" in rest else f"{package}/msg/{rest}"


def attribute(field: str) -> str:
    """The name of a field as an attribute of message objects."""
    return f"{field}_" if keyword.iskeyword(field) else field


class _Counting(Typestore):
    """Makes messages until one call has made too many of them."""

    def __init__(self, types: Typestore) -> None:
        super().__init__(max_sequence_length=MAX_BYTES)
        self.fielddefs = types.fielddefs  # as in a typestore
        self.types = types.types  # as in a typestore
        self.left = 0  # messages it may still make

    def get_msgdef(self, typename: str) -> Msgdef[object]:
        if typename in self.cache:
            return self.cache[typename]
        plain = super().get_msgdef(typename)
        make = plain.cls

        def counted(*values: object) -> object:
            self.left -= 1
            if self.left < 0:
                raise SerdeError(f"more than {MAX_OBJECTS} messages within it")
            return make(*values)

        # rosbags calls a message's class, and does nothing else with it
        counting: Msgdef[object] = dataclasses.replace(plain, cls=cast("type[object]", counted))
        self.cache[typename] = counting
        return counting


class RosTypes:
    """The types of ROS 1 or ROS 2. Any thread may use it.

    Args:
        ros: 1 or 2.
        definitions: texts of further ``.msg`` files by ``pkg/Type``.

    Raises:
        RosError: a definition that cannot be read, or one that differs from a standard type.
    """

    def __init__(self, ros: int, definitions: Mapping[str, str]) -> None:
        self.ros = ros
        self._store = _Counting(get_typestore(_STANDARD[ros]))  # stops where there are too many
        self._checked: set[str] = set()  # names whose fields can be read
        self._lock = threading.Lock()
        for name, text in definitions.items():
            self._register(name, text)

    def _register(self, name: str, text: str) -> None:
        try:
            parsed = get_types_from_msg(text if text.endswith("\n") else f"{text}\n", name)
            for kind, (_, fields) in parsed.items():
                for field, desc in fields:
                    _check_length(kind, field, desc)
            with _registering:
                self._store.register(parsed)
        except RosError:
            raise
        except TypesysError as error:
            if "already present" in str(error):
                raise RosError(
                    f"definition of {name}: ROS {self.ros} has another type of this name; "
                    "give yours a package of its own"
                ) from None
            raise RosError(f"definition of {name} is not a .msg text; correct it") from None
        except (SyntaxError, NameError, RecursionError, *_MISFITS) as error:
            raise RosError(f"definition of {name} cannot be used: {error}; correct it") from None

    def known(self, name: str) -> bool:
        """Whether messages of a type can be read and written."""
        try:
            self.check(name)
        except RosError:
            return False
        return True

    def check(self, name: str) -> str:
        """The long name of a type that can be used. Raises RosError."""
        name = long_name(name)
        if name not in self._checked:
            self._check(name, ())
        return name

    def _check(self, name: str, inside: tuple[str, ...]) -> None:
        if name not in self._store.fielddefs:
            within = f" (within {inside[-1]})" if inside else ""
            raise RosError(
                f"type {name}{within} is not a standard one of ROS {self.ros}; add the text of its "
                ".msg file to the team's definitions"
            )
        if name in inside or len(inside) >= MAX_DEPTH:
            raise RosError(f"type {name} holds itself or is nested more than {MAX_DEPTH} deep")
        for _, desc in self._store.fielddefs[name][1]:
            inner = element(desc)
            if inner[0] == Nodetype.NAME and inner[1] not in self._checked:
                self._check(str(inner[1]), (*inside, name))
        self._checked.add(name)

    def fields(self, name: str) -> Iterator[tuple[str, FieldDesc]]:
        """Names and descriptions of the fields of a type that has been checked."""
        return (field for field in self._store.fielddefs[name][1] if field[0] != FILLER)

    def make(self, name: str, values: Mapping[str, object]) -> object:
        """A message object from the values of all its fields, by their ROS names."""
        return self._store.types[name](**{attribute(key): v for key, v in values.items()})  # type: ignore[arg-type]

    def holds(self, name: str, message: object) -> bool:
        """Whether an object is a message of this type, as this version of ROS has it."""
        return isinstance(message, self._store.types.get(name, ()))

    def read(self, name: str, data: bytes) -> object:
        """The message object that bytes hold. Raises RosError."""
        name = self.check(name)
        if len(data) > MAX_BYTES:
            raise RosError(f"{len(data)} bytes; at most {MAX_BYTES} are read")
        with self._lock:
            self._store.left = MAX_OBJECTS
            try:
                if self.ros == 1:
                    return self._store.deserialize_ros1(data, name)
                return self._store.deserialize_cdr(data, name)
            except _MISFITS as error:
                raise RosError(f"not a {name} of ROS {self.ros}: {error}") from None

    def write(self, name: str, message: object) -> bytes:
        """The bytes of a message object: ROS 1, or CDR (little endian). Raises RosError."""
        name = self.check(name)
        with self._lock:
            try:
                if self.ros == 1:
                    return bytes(self._store.serialize_ros1(message, name))
                return bytes(self._store.serialize_cdr(message, name, little_endian=True))
            except _MISFITS as error:
                raise RosError(f"no {name} can be made of this: {error}") from None

    def definition(self, name: str) -> tuple[str, str]:
        """The full text of a type with all that it holds, and its ROS 1 MD5 sum."""
        with self._lock:
            return self._store.generate_msgdef(self.check(name), self.ros)


def element(desc: FieldDesc) -> tuple[int, Any]:
    """What a field holds, or what its elements are."""
    if desc[0] in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        inner: Any = desc[1][0]
        return inner[0], inner[1]
    return desc[0], desc[1]


def _check_length(kind: str, field: str, desc: FieldDesc) -> None:
    if desc[0] != Nodetype.ARRAY:
        return
    inner, length = element(desc), int(desc[1][1])
    many = inner[0] == Nodetype.NAME or inner[1][0] == "string"
    if not 0 < length <= (MAX_ARRAY if many else MAX_BYTES // 8):
        raise RosError(f"definition of {kind}: array {field} cannot have {length} elements")
