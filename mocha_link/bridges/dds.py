"""The ROS 2 side of a bridge without a ROS installation: CycloneDDS is the DDS participant.

Types are made from their definitions. A sample is its serialized bytes: DDS learns what the type
is, so that it can match others, but nothing is decoded.
"""

from __future__ import annotations

import logging
import os
import threading
from collections.abc import Callable, Collection, Mapping
from types import MappingProxyType
from typing import Any

from mocha_link.bridges.ros_clients import Cdr
from mocha_link.errors import Guard, MochaLinkError, needs_extra
from mocha_link.lifetime import Closeable
from mocha_link.ros import RosTypes, element

with needs_extra("ROS 2", "ros2"):
    from cyclonedds.core import (
        DDSException,
        GuardCondition,
        InstanceState,
        Listener,
        ReadCondition,
        SampleState,
        ViewState,
        WaitSet,
    )
    from cyclonedds.domain import DomainParticipant
    from cyclonedds.idl import IdlStruct, make_idl_struct, types
    from cyclonedds.pub import DataWriter
    from cyclonedds.qos import Policy, Qos
    from cyclonedds.sub import DataReader
    from cyclonedds.topic import Topic
    from cyclonedds.util import duration
    from rosbags.interfaces import Nodetype
    from rosbags.interfaces.typing import FieldDesc

_BASES: dict[str, Any] = {"bool": bool, "string": str, "char": types.uint8}  # others by their name


class Sample:
    """The bytes of a message, as the samples of all types."""

    def __init__(self, data: bytes) -> None:
        self.data = data

    def serialize(self, *_: object, **__: object) -> bytes:
        """The bytes, unchanged."""
        return self.data


def _read(cls: type[Sample], data: bytes, /, *_: object, **__: object) -> Sample:
    return cls(data)


class DdsTypes:
    """Makes the types of topics, once each.

    Args:
        definitions: texts of ``.msg`` files by ``pkg/Type``, besides the standard ones.
        spaces: ``srv`` or ``action`` by ``pkg/Type``, of definitions that are parts of one.

    Raises:
        RosError: one of them cannot be used.
    """

    def __init__(
        self, definitions: Mapping[str, str], spaces: Mapping[str, str] = MappingProxyType({})
    ) -> None:
        self._types = RosTypes(2, definitions)
        self._spaces = spaces
        self._structs: dict[str, Any] = {}  # of nested messages, by name
        self._roots: dict[str, Any] = {}  # of topics, by name

    def of(self, kind: str) -> Any:
        """The DDS type of a topic.

        Args:
            kind: the name of the ROS type, e.g. ``geometry_msgs/Pose``.

        Raises:
            RosError: the type is unknown, or cannot be used.
        """
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
        space = self._spaces.get(f"{package}/{short}", space)
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


MAX_DOMAIN = 232  # its ports are the last ones
MIN_DEPTH = 10  # samples that wait for a reader
MAX_SAMPLES = 100  # samples at once
_RELIABILITY = 11  # the policy's number in DDS
_LISTENER: Any = Listener  # whose arguments have no types

LOG = logging.getLogger("mocha_link")


class DdsError(MochaLinkError):
    """A DDS domain cannot be joined."""


class Dds(Cdr, Closeable):
    """Publishes and subscribes to the topics of ROS 2 nodes in a DDS domain. A context manager.

    A topic name that begins with ``/`` is a ROS topic. Any other name is used in DDS as given, as
    for the topics of services.

    Args:
        definitions: texts of the team's ``.msg`` files by ``pkg/Type``.
        domain: the number of the domain; default: the variable ROS_DOMAIN_ID, or 0.
        best_effort: topics to subscribe to with best effort, as their publishers offer no more.
        spaces: as of `DdsTypes`.

    Raises:
        RosError: one of the definitions cannot be used.
        DdsError: the domain cannot be joined.
    """

    def __init__(
        self,
        definitions: Mapping[str, str],
        *,
        domain: int | None = None,
        best_effort: Collection[str] = (),
        spaces: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        self._types = DdsTypes(definitions, spaces)
        self._best_effort = best_effort
        self._participant = _joined(domain)
        self._writers: dict[str, Any] = {}  # by topic
        # reader, its condition, who takes the data
        self._readers: list[tuple[Any, Any, Callable[[bytes], None]]] = []
        self._lock = threading.Lock()
        self._stopping = False  # set by `close`
        self._guard = Guard("samples of a DDS topic were not taken in; other topics are")
        self._awake = GuardCondition(self._participant)  # triggered to end the wait
        self._waiting = WaitSet(self._participant)  # for data, or for `_awake`
        self._waiting.attach(self._awake)
        self._thread = threading.Thread(target=self._read, name="DDS reader", daemon=True)
        self._thread.start()

    def subscribe(self, topic: str, kind: str, history: int, take: Callable[[bytes], None]) -> Any:
        """Subscribe to a topic. An exception of `take` is logged.

        Args:
            topic: the name of the topic.
            kind: the name of its ROS type.
            history: the depth of the queue, in messages.
            take: receives the CDR bytes of every message, on the reader thread.

        Returns:
            The DDS reader.

        Raises:
            RosError: the type is unknown.
        """
        with self._lock:
            reader = DataReader(
                self._participant,
                self._topic(topic, kind),
                qos=_qos(history, reliable=topic not in self._best_effort, lasting=False),
                listener=_LISTENER(
                    on_requested_incompatible_qos=lambda _, status: _refused(topic, status)
                ),
            )
            unread = ReadCondition(reader, SampleState.Any | ViewState.Any | InstanceState.Any)
            self._readers.append((reader, unread, take))
            self._waiting.attach(unread)
        return reader

    def advertise(self, topic: str, kind: str, history: int, *, lasting: bool = True) -> Any:
        """Create the writer of a topic, so that subscribers match it before the first message.

        Args:
            topic: the name of the topic.
            kind: the name of its ROS type.
            history: the depth of the queue, in messages.
            lasting: transient local durability: late subscribers that request it receive the newest
                messages.

        Returns:
            The DDS writer.

        Raises:
            RosError: the type is unknown.
        """
        if topic not in self._writers:
            self._writers[topic] = DataWriter(
                self._participant,
                self._topic(topic, kind),
                qos=_qos(history, reliable=True, lasting=lasting),
            )
        return self._writers[topic]

    def publish(self, topic: str, kind: str, history: int, data: bytes) -> None:
        """Publish a message; late subscribers that request it receive the newest ones.

        Args:
            topic: the name of the topic.
            kind: the name of its ROS type.
            history: the depth of the queue, in messages.
            data: the CDR bytes.

        Raises:
            RosError: the type is unknown.
        """
        self.advertise(topic, kind, history).write(self._types.of(kind)(data))

    def close(self) -> None:
        """Leave the domain; may be called twice."""
        if self._stopping:
            return
        self._stopping = True
        self._awake.set(True)
        self._thread.join()
        self._participant.__del__()  # the library keeps it until the process ends

    def _topic(self, topic: str, kind: str) -> Any:
        name = f"rt{topic}" if topic.startswith("/") else topic
        return Topic(self._participant, name, self._types.of(kind))

    def _read(self) -> None:
        while not self._stopping:
            self._waiting.wait(duration(infinite=True))
            with self._lock:
                readers = list(self._readers)
            for reader, _, take in readers:
                try:
                    for sample in reader.take(MAX_SAMPLES):
                        data = getattr(sample, "data", b"")  # that a publisher ended has none
                        if data:
                            with self._guard:
                                take(data)
                except DDSException as error:
                    LOG.warning("cannot read %s: %s", reader.topic.name, error)


def _refused(topic: str, status: Any) -> None:
    """Log that DDS does not join a publisher to a subscriber that wants more than it offers."""
    if status.last_policy_id == _RELIABILITY:
        text = "%s is not received: its publisher is not reliable; pass --best-effort %s"
        LOG.warning(text, topic, topic)
    else:
        LOG.warning("%s is not received: its publisher's QoS offers less than ours requests", topic)


def _joined(domain: int | None) -> DomainParticipant:
    number = os.environ.get("ROS_DOMAIN_ID") or "0" if domain is None else str(domain)
    try:
        if not number.isdecimal() or int(number) > MAX_DOMAIN:
            raise DdsError(
                f"{number} is no DDS domain, 0 to {MAX_DOMAIN} (--domain, ROS_DOMAIN_ID)"
            )
        return DomainParticipant(int(number))
    except DDSException as error:
        raise DdsError(
            f"DDS domain {number} cannot be joined: {error}; is CYCLONEDDS_URI right?"
        ) from None


def _qos(history: int, *, reliable: bool, lasting: bool) -> Qos:
    reliability = Policy.Reliability
    durability = Policy.Durability
    return Qos(
        reliability.Reliable(duration(seconds=1)) if reliable else reliability.BestEffort,
        durability.TransientLocal if lasting else durability.Volatile,
        Policy.History.KeepLast(history if lasting else max(history, MIN_DEPTH)),
    )
