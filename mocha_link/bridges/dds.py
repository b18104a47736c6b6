"""The ROS 2 side of a bridge without a ROS installation: CycloneDDS speaks to the topics."""

from __future__ import annotations

import logging
import os
import threading
from collections.abc import Callable, Collection, Mapping
from typing import Any

from cyclonedds.core import (
    DDSException,
    GuardCondition,
    InstanceState,
    ReadCondition,
    SampleState,
    ViewState,
    WaitSet,
)
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from mocha_link.bridges.cdr import Cdr
from mocha_link.bridges.dds_types import DdsTypes

MIN_DEPTH = 10  # samples that wait for a reader
TAKEN = 100  # samples at once

LOG = logging.getLogger("mocha_link")


class Dds(Cdr):
    """Publishes and subscribes the topics of ROS 2 nodes in a DDS domain.

    Args:
        definitions: of the team's message types.
        domain: number of the domain; default: that of the variable ROS_DOMAIN_ID, or 0.
        best_effort: topics that are subscribed that way, because their publishers do no better.

    Raises:
        RosError: one of the definitions cannot be used.
    """

    def __init__(
        self,
        definitions: Mapping[str, str],
        *,
        domain: int | None = None,
        best_effort: Collection[str] = (),
    ) -> None:
        if domain is None:
            domain = int(os.environ.get("ROS_DOMAIN_ID") or 0)
        self._types = DdsTypes(definitions)
        self._best_effort = best_effort
        self._participant = DomainParticipant(domain)
        self._writers: dict[str, Any] = {}
        self._readers: list[tuple[Any, Any, Callable[[bytes], None]]] = []
        self._lock = threading.Lock()
        self._stopping = False
        self._awake = GuardCondition(self._participant)
        self._waiting = WaitSet(self._participant)
        self._waiting.attach(self._awake)
        self._thread = threading.Thread(target=self._read, name="DDS reader", daemon=True)
        self._thread.start()

    def subscribe(self, topic: str, kind: str, history: int, hand: Callable[[bytes], None]) -> None:
        """See `bridge.Middleware`."""
        with self._lock:
            reader = DataReader(
                self._participant,
                self._topic(topic, kind),
                qos=_qos(history, reliable=topic not in self._best_effort, lasting=False),
            )
            unread = ReadCondition(reader, SampleState.Any | ViewState.Any | InstanceState.Any)
            self._readers.append((reader, unread, hand))
            self._waiting.attach(unread)

    def publish(self, topic: str, kind: str, history: int, data: bytes) -> None:
        """See `bridge.Middleware`. The newest stay for subscribers that come later and ask so."""
        made = self._types.of(kind)
        if topic not in self._writers:
            self._writers[topic] = DataWriter(
                self._participant,
                self._topic(topic, kind),
                qos=_qos(history, reliable=True, lasting=True),
            )
        self._writers[topic].write(made(data))

    def close(self) -> None:
        """See `bridge.Middleware`."""
        self._stopping = True
        self._awake.set(True)
        self._thread.join()

    def _topic(self, topic: str, kind: str) -> Any:
        return Topic(self._participant, f"rt{topic}", self._types.of(kind))

    def _read(self) -> None:
        while not self._stopping:
            self._waiting.wait(duration(infinite=True))
            with self._lock:
                readers = list(self._readers)
            for reader, _, hand in readers:
                try:
                    for sample in reader.take(TAKEN):
                        data = getattr(sample, "data", b"")  # that a publisher ended has none
                        if data:
                            hand(data)
                except DDSException as error:
                    LOG.warning("cannot read %s: %s", reader.topic.name, error)


def _qos(history: int, *, reliable: bool, lasting: bool) -> Qos:
    reliability = Policy.Reliability
    durability = Policy.Durability
    return Qos(
        reliability.Reliable(duration(seconds=1)) if reliable else reliability.BestEffort,
        durability.TransientLocal if lasting else durability.Volatile,
        Policy.History.KeepLast(history if lasting else max(history, MIN_DEPTH)),
    )
