"""What stands in a team file: its keys, and what each of them may be."""

from __future__ import annotations

import enum
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Literal, Self
from urllib.parse import parse_qsl

from pydantic import AfterValidator, BaseModel, PlainSerializer, PlainValidator, StringConstraints
from pydantic import Field as Key
from pydantic_core import PydanticCustomError

from mocha_link.errors import RadioError
from mocha_link.hosts import ANY, NAME, NUMBER_6, as_host
from mocha_link.team.installed_radios import radios_of_others

MAX_RADIO_ID = 128  # some MAC addresses and an IP address
IDS = 256  # robot, topic and type ids are one byte on the wire
MAX_HISTORY = 1000
LAST_PORT = 65535

Ros = Literal[1, 2]
"""How ROS messages are serialized: as ROS 1, or as ROS 2 (CDR)."""


@dataclass(frozen=True, slots=True)
class PortRange:
    """`count` ports at an address, from `first` on: one for each client of a robot."""

    address: str | None  # None: unknown, so that nothing can clash
    first: int
    count: int

    @property
    def last(self) -> int:
        """The last of them."""
        return self.first + self.count - 1

    def overlaps(self, other: PortRange) -> bool:
        """Whether both want some port of the same address."""
        first, last = max(self.first, other.first), min(self.last, other.last)
        return self.address is not None and self.address == other.address and first <= last

    def faults(self, others: Mapping[str, PortRange], key: str) -> Iterator[tuple[str, str]]:
        """Problem codes and messages, beside the ranges of others by the names of their robots.

        Args:
            others: the ranges before it in the file, so that each pair is reported once.
            key: how the file calls the first port.
        """
        if self.last > LAST_PORT:
            yield "port-too-high", f"the last port would be {self.last}; use a lower {key}"
        for name, other in others.items():
            if self.overlaps(other):
                message = (
                    f"ports {self.first} to {self.last} overlap those of {name} at the same "
                    f"address ({other.first} to {other.last}); use {other.last + 1} or more"
                )
                yield "ports-overlap", message


_PLACE, _PORT = rf"//(?P<host>{NAME}|\[{NUMBER_6}\])", r":(?P<port>\d{1,5})"


@dataclass(frozen=True, slots=True)
class _Form:
    shown: str  # an example, for messages
    pattern: str  # of the part between scheme and options
    options: tuple[str, ...] | None = ()  # that such a URL may have; None: any


_ANY = r"(//(?P<host>[^/?#:\s]*)(:(?P<port>\d{1,5}))?)?[^?\s]*"
"""Of a radio of another package, which reads the text itself."""

FORMS: Mapping[str, _Form] = {
    "udp": _Form("udp://host:port", _PLACE + _PORT),
    "tcp": _Form("tcp://host:port", _PLACE + _PORT),
    "stdin": _Form("stdin:", ""),
    "wifi": _Form("wifi://interface", _PLACE),
    "rajant": _Form(
        "rajant://host:port or rajant://host?jar=monitor.jar", f"{_PLACE}({_PORT})?", ("jar",)
    ),
    "babel": _Form(
        "babel://localhost:port or babel:/path/of/socket",
        rf"({_PLACE}{_PORT}|(?P<path>/[^/?][^?]*))",
    ),
    "mavlink": _Form("mavlink://host:port?peer=robot", _PLACE + _PORT, ("peer",)),
}


class RadioUrlError(RadioError, ValueError):
    """A text that is not the URL of a radio."""


@dataclass(frozen=True, slots=True)
class RadioUrl:
    """A radio's URL in its parts; `str` gives the text back."""

    scheme: str
    host: str
    port: int | None  # None: the URL has none
    options: Mapping[str, str] = field(hash=False)  # behind the question mark
    text: str  # as it was written
    path: str = ""  # of a socket

    @classmethod
    def parse(cls, text: str, scheme: str | None = None) -> Self:
        """Read a URL, of one scheme if that is given. Raises RadioUrlError."""
        head, mark, query = text.partition("?")
        found = scheme or head.partition(":")[0]
        form = FORMS.get(found)
        if form is None:
            others = radios_of_others(FORMS)
            if found not in others:
                shown = [each.shown for each in FORMS.values()] + [f"{name}:..." for name in others]
                raise _wrong(text, ", ".join(shown))
            form = _Form(f"{found}:...", _ANY, None)
        match = re.fullmatch(f"{re.escape(found)}:{form.pattern}", head)
        try:
            pairs = parse_qsl(query, strict_parsing=True, max_num_fields=4) if mark else []
        except ValueError:
            raise _wrong(text, form.shown) from None
        options, parts = dict(pairs), match.groupdict() if match else {}
        port = int(parts["port"]) if parts.get("port") else None
        fits = (
            match is not None
            and (port or 0) <= LAST_PORT
            and len(options) == len(pairs)
            and (form.options is None or options.keys() <= set(form.options))
        )
        if not fits or (found == "rajant" and (port is None) != ("jar" in options)):
            raise _wrong(text, form.shown)
        try:
            host = as_host(parts["host"]) if parts.get("host") else ""
        except ValueError:
            raise _wrong(text, form.shown) from None
        return cls(found, host, port, options, text, parts.get("path") or "")

    def __str__(self) -> str:
        return self.text


def _a_radio(text: str) -> str:
    RadioUrl.parse(text)
    return text


def _wrong(text: str, forms: str) -> RadioUrlError:
    shown = text if len(text) <= 60 else text[:57] + "..."
    return RadioUrlError(f"'{shown}' is no radio; write {forms}")


def _a_name(text: str) -> str:
    if not re.fullmatch(r"[^\s/:]{1,64}", text):
        raise ValueError(f"'{text:.40}' is no name: use 1 to 64 characters without spaces, / and :")
    return text


def _a_host(text: str) -> str:
    try:
        return as_host(text)
    except ValueError as error:
        raise PydanticCustomError("wrong-form", "{why}", {"why": str(error)}) from None


def _a_bind_address(text: str) -> str:
    return text if text == ANY else _a_host(text)


def _a_type(text: str) -> str:
    if not re.fullmatch(r"[A-Za-z0-9_]+/[A-Za-z0-9_]+", text):
        raise ValueError(f"'{text:.40}' is no type: write package/Type, letters, digits and _ only")
    return text


def _a_datum(values: tuple[float, ...]) -> tuple[float, ...]:
    if not (abs(values[0]) <= 90 and abs(values[1]) <= 180 and abs(values[-1]) <= 360):
        raise ValueError("write [latitude, longitude] or [latitude, longitude, yaw] in degrees")
    return values


Name = Annotated[str, AfterValidator(_a_name)]
TypeKey = Annotated[str, AfterValidator(_a_type)]
Host = Annotated[str, AfterValidator(_a_host)]


TypeName = Annotated[
    str,
    StringConstraints(pattern=r"^[A-Za-z0-9_]+/[A-Za-z0-9_]+$"),
    Key(description="package/Type, letters, digits and _ only"),
]


class Priority(enum.IntEnum):
    """How urgent a topic is; more urgent messages of a robot are exchanged first."""

    NONE = 0
    LOW = 1
    MEDIUM = 2
    HIGH = 3


class Trust(enum.Enum):
    """Who may hand on whose messages: any robot of the team, or only what its maker signed."""

    RELAYS = "relays"
    SIGNED = "signed"


def _a_priority(value: object) -> Priority:
    names = {priority.name.lower(): priority for priority in Priority}
    if isinstance(value, str) and value in names:
        return names[value]
    expected = ", ".join(map(repr, names))
    raise PydanticCustomError("literal_error", "must be one of {expected}", {"expected": expected})


class TopicModel(BaseModel, frozen=True):
    """One kind of message of robots of a kind.

    The newest `history` messages are kept and carried (original nodes carry the newest only).
    With `aggregate` the messages within `min_interval_s` go together; without, the newest of them.
    """

    name: Annotated[str, StringConstraints(min_length=1, max_length=256)]
    type: TypeName
    priority: Annotated[
        Priority,
        PlainValidator(_a_priority),
        PlainSerializer(lambda priority: priority.name.lower()),
    ] = Priority.NONE
    min_interval_s: Annotated[float, Key(ge=0)] = 0.0
    history: Annotated[int, Key(ge=1, le=MAX_HISTORY, description="how many messages to keep")] = 1
    aggregate: bool = False


class KindModel(BaseModel):
    """The topics of a kind of robot."""

    topics: Annotated[list[TopicModel], Key(max_length=IDS)]


class RobotModel(BaseModel, frozen=True):
    """One robot. `address` is what others dial, `listen` what its node binds.

    Without an `address` others find it by mDNS.
    `clients` are in the order of the ports; None keeps a port unused. `radio_id` is by what the
    radios of others know it (MAC address, serial number). `key` is its public Ed25519 key in Z85.
    `original`: it runs the original MOCHA node. `ros`: how its ROS messages are serialized.
    `datum`: where the origin of the local frame of its ROS messages lies: latitude and longitude in
    degrees, and by how much x is turned from east, counterclockwise.
    """

    kind: Annotated[str, Key(description="one of the names under kinds")]
    address: Annotated[
        Host | None, Key(description="host name or address that the others dial")
    ] = None
    base_port: Annotated[int, Key(ge=1, le=65535, description="first of its ports")]
    clients: Annotated[
        tuple[Name | None, ...], Key(description="the robots that may link to it, in port order")
    ]
    listen: Annotated[
        str,
        AfterValidator(_a_bind_address),
        Key(description="* or an address of this machine"),
    ] = ANY
    radio: Annotated[
        Annotated[str, AfterValidator(_a_radio)] | None,
        Key(description="the URL of its radio, e.g. udp://host:port"),
    ] = None
    radio_id: Annotated[
        Annotated[str, StringConstraints(min_length=1, max_length=MAX_RADIO_ID)] | None,
        Key(description=f"its addresses for radios, 1 to {MAX_RADIO_ID} characters"),
    ] = None
    key: Annotated[
        Annotated[str, StringConstraints(pattern=r"^[0-9A-Za-z.\-:+=^!/*?&<>()\[\]{}@%$#]{40}$")]
        | None,
        Key(description="40 characters in quotes, as 'mocha-link keys' writes them"),
    ] = None
    original: bool = False
    ros: Ros = 1
    datum: Annotated[
        Annotated[tuple[float, ...], Key(min_length=2, max_length=3), AfterValidator(_a_datum)]
        | None,
        Key(description="latitude and longitude of the origin of its local frame"),
    ] = None


class Trigger(BaseModel, frozen=True):
    """When a node pulls from a peer: in contact (by RSSI) at once, then every `interval_s`.

    A robot without a radio tries every `interval_s`. In contact means a signal at or above the
    threshold for its unit; the contact ends `hysteresis_db` below it. `budget_bytes` is what a node
    takes in from a peer in one contact; None: no limit.
    """

    rssi_threshold_dbm: Annotated[float, Key(ge=-200, le=200)] = -75.0
    snr_threshold_db: Annotated[float, Key(ge=-200, le=200)] = 10.0
    device_threshold: Annotated[float, Key(ge=-1e6, le=1e6)] = 20.0  # in the radio's own unit
    hysteresis_db: Annotated[float, Key(ge=0, le=100)] = 3.0
    interval_s: Annotated[float, Key(gt=0)] = 2.0
    budget_bytes: Annotated[int, Key(ge=1024)] | None = None


class TeamModel(BaseModel):
    """All of it."""

    robots: Annotated[dict[Name, RobotModel], Key(min_length=1, max_length=IDS)]
    kinds: dict[str, KindModel]
    trigger: Trigger = Trigger()
    trust: Trust = Trust.RELAYS
    definitions: dict[TypeKey, str] = {}
