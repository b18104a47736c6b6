"""A gossip node to embed: construct it with the team and a robot name, publish, watch the links."""

from __future__ import annotations

import asyncio
import sys
import threading
import time
import warnings
from collections.abc import Callable, Coroutine, Iterable
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, ParamSpec, Self, TypeVar
from weakref import WeakMethod

from mocha_link.clock import Clock, Instant, SystemClock
from mocha_link.errors import MochaLinkError
from mocha_link.forks import parents_only
from mocha_link.lifetime import Startable
from mocha_link.links import LinkEvent, LinkMetrics, Reading, StorageFailed, StorageRecovered
from mocha_link.logs import NodeLog
from mocha_link.node.broadcast import Broadcast, EventStream
from mocha_link.node.gossip import TIMEOUT_S, Gossip
from mocha_link.node.transport import Transport
from mocha_link.radios import Radio, open_radio
from mocha_link.store import (
    Database,
    Header,
    Message,
    Record,
    Storage,
    StorageError,
    TeamConfig,
    as_bytes,
    message_of,
    sign,
    wire,
)
from mocha_link.team import Robot, Team, peer_keys, secret_key

CLOSE_S = 0.95  # for all parts together; `close` promises one second
LEAST_CLOSE_S = 0.05
LARGE_BYTES = 64 * 1024  # compressing such a payload takes long

_Event = TypeVar("_Event", bound=LinkEvent)
_Given = ParamSpec("_Given")


class NodeClosedError(MochaLinkError):
    """A node was used after its end, or started twice."""


class Node(Startable):
    """The gossip node of one robot: its ports, its pulls, its messages.

    Use it as a context manager (``with``, or ``async with`` in asyncio), or call `start` and
    `close`. Every method may be called from any thread. In a process that was forked beside it
    every method raises ForkedError. A node that is dropped without `close` emits a ResourceWarning
    and closes.

    Args:
        team: the team, or its team file; every robot must load the same file.
        name: the robot that this node belongs to.
        clock: the robot's clock for stamps, ages and triggers; default: this machine's.
        radio: the source of signal readings; default: the radio of the robot in the team file. A
            robot without a radio pulls from all peers by the timer.
        timeout_s: real seconds without a byte after which the node aborts a pull.
        storage: a file in which messages survive the end of the process; default: none, messages
            stay in memory. The node keeps the file open from construction until `close`.
        keys: the folder with ``<name>.key``, the robot's secret, if the team has a key for it.
        datagrams: use UDP between new nodes where UDP is faster.

    Raises:
        UnknownRobotError: the team has no robot of that name.
        RadioError: the URL of the radio in the team file is invalid.
        KeyFileError: the secret is missing or invalid, or other users can read it.
        KeyMismatchError: the secret does not match the key in the team file.
        KeysUnavailableError: the team has keys, and the extra ``keys`` is not installed.
        DocumentError: the team file cannot be read, or has problems.
    """

    _closed = True  # a node whose constructor failed has nothing to close

    def __init__(  # noqa: PLR0913 - all optional parts
        self,
        team: Team | Path | str,
        name: str,
        *,
        clock: Clock | None = None,
        radio: Radio | None = None,
        timeout_s: float = TIMEOUT_S,
        storage: Path | str | None = None,
        keys: Path | str | None = None,
        datagrams: bool = True,
    ) -> None:
        team = team if isinstance(team, Team) else Team.load(team)
        robot = team.robot(name)
        self._secret = secret_key(team, name, Path(keys) if keys else None)
        if radio is None and robot.radio is not None:
            radio = open_radio(robot.radio, team, name)
        self.team = team
        self.name = name
        self.clock: Clock = clock or SystemClock()
        self._radio = radio
        self._lock = threading.Lock()
        log = NodeLog(name)
        self._broadcast = Broadcast(log)
        self._transport: Transport | None = None  # set by `start`
        # Storage events from before the gossip exists; None: it exists.
        self._early: list[LinkEvent] | None = []
        self._peer_keys = peer_keys(team, robot) if self._secret else {}  # by protected peer
        self._storage = (
            Storage(
                Path(storage), config=TeamConfig.of(team), on_fault=_weakly(self._fault), log=log
            )
            if storage
            else None
        )
        try:
            self._gossip = Gossip(
                team,
                name,
                by_timer=radio is None,
                timeout_s=timeout_s,
                database=Database(team.histories, self._storage),
                sign=partial(sign, self._secret, robot) if self._secret else None,
                datagrams=datagrams,
                protected=self._peer_keys,
            )
        except BaseException:
            if self._storage:
                self._storage.close()
            raise
        parents_only(self)
        self._closed = False  # a closed node cannot be started again
        with self._lock:
            early, self._early = self._early, None
            for event in early or ():
                self._gossip.announce(event)

    @property
    def robot(self) -> Robot:
        """The robot of this node."""
        return self._gossip.me

    def start(self) -> None:
        """Bind the ports, serve requests and begin to pull.

        Raises:
            PortInUseError: another process or node has one of the ports.
            ListenError: the robot's `listen` is not an address of this machine.
            RadioError: another process has the port of the radio.
            MissingExtraError: a robot has no address in the team file, and the extra ``mdns`` is
                not installed.
            NodeClosedError: the node was started or closed before.
        """
        if self._transport or self._closed:
            raise NodeClosedError(f"the node of {self.name} runs once; make a new one")
        transport = Transport(
            self._gossip,
            self.team,
            lock=self._lock,
            now=partial(_instant, self.clock),
            deliver=self._broadcast.send,
            secret=self._secret,
            keys=self._peer_keys,
            simulated=not isinstance(self.clock, SystemClock),
        )
        self._transport = transport  # before its thread starts: listeners use it from there
        try:
            transport.start()
        except BaseException:
            self._transport = None
            raise
        if self._radio and not self._closed:
            try:
                self._radio.start(_weakly(self._signal_received))
            except BaseException:
                self.close()
                raise
        if self._closed:  # a listener or another thread closed it during the start
            self._end()

    def close(self) -> None:
        """Stop within a second and release every socket and thread; may be called twice.

        Listeners receive no event after this call. The node logs a listener that has not returned
        by then; the ports become free when that listener returns.
        """
        if not self._closed:
            self._closed = True
            self._end()

    async def __aenter__(self) -> Self:
        """Start, on the thread of the event loop: a radio may make tasks."""
        return self.__enter__()

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close without blocking the event loop."""
        if not self._closed:
            self._closed = True
            try:
                if self._radio:
                    self._radio.close()  # its tasks may run on this event loop
            finally:
                await asyncio.shield(asyncio.to_thread(self._end_node))

    def __del__(self) -> None:
        if self._closed or sys.is_finalizing():
            return
        if self._transport or self._storage:
            warnings.warn(
                f"the node of {self.name} was dropped without close(); use 'with Node(...)'",
                ResourceWarning,
                stacklevel=2,
                source=self,
            )
        self.close()

    def _end(self) -> None:
        until_s = time.monotonic() + CLOSE_S
        try:
            if self._radio:
                self._radio.close()
        finally:
            self._end_node(until_s)

    def _end_node(self, until_s: float | None = None) -> None:
        until_s = until_s or time.monotonic() + CLOSE_S
        if self._transport:
            self._transport.close()
        if self._storage:
            with self._lock:  # messages that wait for their interval must not be lost
                for topic in self.team.topics_of(self.name):
                    self._gossip.flush(topic, self._now())
            self._storage.close(max(until_s - time.monotonic(), LEAST_CLOSE_S))
        self._broadcast.close()

    def publish(self, topic: str, data: bytes, *, now: bool = False) -> Header:
        """Store a message of this robot, so that peers can pull it.

        While `min_interval_s` of the topic has not passed since the last message, the new message
        waits. A newer message replaces the waiting one, or joins it if the topic has `aggregate`.
        If the node has a working `storage`, the message is on disk when the call returns, with two
        exceptions: a message that waits for its interval is stored when the interval has passed,
        by `flush` or by `close`; and a call from a listener does not wait for the disk.

        Args:
            topic: the name of a topic of this robot.
            data: the payload, at most 64 MiB.
            now: publish at once, even if `min_interval_s` has not passed.

        Returns:
            The header of the message.

        Raises:
            UnknownTopicError: the team file gives this robot no such topic.
            PayloadError: the payload is larger than 64 MiB.
            TypeError: `data` is not bytes, bytearray or memoryview; encode it first.
            NodeClosedError: the node is closed.
        """
        self._check_open()
        known = self.team.topic(self.name, topic)
        data = as_bytes(data, topic)
        large = len(data) >= LARGE_BYTES and not known.aggregate
        frame = wire.compress(data) if large else None  # without the lock: the node keeps running
        with self._lock:
            header = self._gossip.publish(known, data, self._now(), at_once=now, frame=frame)
        self._wake()
        if self._storage and not (self._transport and self._transport.is_current_thread()):
            self._storage.wait()
        return header

    async def published(self, topic: str, data: bytes, *, now: bool = False) -> Header:
        """`publish` for asyncio: compression and disk writes do not block the event loop.

        The message is published even if the waiting task is cancelled.

        Args:
            topic: the name of a topic of this robot.
            data: the payload, at most 64 MiB.
            now: publish at once, even if `min_interval_s` has not passed.

        Returns:
            The header of the message.

        Raises:
            UnknownTopicError: the team file gives this robot no such topic.
            PayloadError: the payload is larger than 64 MiB.
            TypeError: `data` is not bytes, bytearray or memoryview; encode it first.
            NodeClosedError: the node is closed.
        """
        return await asyncio.to_thread(self.publish, topic, data, now=now)

    def flush(self, topic: str) -> None:
        """Publish the message of a topic that waits for its interval.

        Args:
            topic: the name of a topic of this robot.

        Raises:
            UnknownTopicError: the team file gives this robot no such topic.
            NodeClosedError: the node is closed.
        """
        self._check_open()
        known = self.team.topic(self.name, topic)
        with self._lock:
            self._gossip.flush(known, self._now())
        self._wake()

    def latest(self, robot: str, topic: str) -> Message | None:
        """The newest message of a topic of a robot.

        Args:
            robot: the name of the robot that published it.
            topic: the name of the topic.

        Returns:
            The message; None if the node has not received one.

        Raises:
            UnknownRobotError: the team has no such robot.
            UnknownTopicError: the robot has no such topic.
        """
        known = self.team.topic(robot, topic)
        robot_id = self.team.robot(robot).robot_id
        record = self._gossip.database.newest(robot_id, known.topic_id)
        return message_of(record, self.team) if record else None

    def messages(self) -> list[Message]:
        """The newest message of every topic of every robot, most urgent first."""
        return self._messages(self._gossip.database.records())

    def history(self, robot: str, topic: str) -> list[Message]:
        """The versions of a topic that the node keeps (`history` in the team file).

        Args:
            robot: the name of the robot that published them.
            topic: the name of the topic.

        Returns:
            The messages, newest first.

        Raises:
            UnknownRobotError: the team has no such robot.
            UnknownTopicError: the robot has no such topic.
        """
        known = self.team.topic(robot, topic)
        robot_id = self.team.robot(robot).robot_id
        return self._messages(self._gossip.database.history(robot_id, known.topic_id))

    def _messages(self, records: Iterable[Record]) -> list[Message]:
        found = (message_of(record, self.team) for record in records)
        return [message for message in found if message]

    @property
    def epoch(self) -> int:
        """Identifies the database.

        Sequence numbers of `stored_since` are valid within one epoch.
        """
        return self._gossip.database.epoch

    def stored_since(self, sequence: int, limit: int | None = None) -> list[tuple[int, Message]]:
        """The messages that were stored after a sequence number.

        Args:
            sequence: the last number that the program has processed; 0: from the beginning.
            limit: at most so many messages; None: all.

        Returns:
            Pairs of sequence number and message, by ascending number. Versions that the node no
            longer keeps are omitted. Continue with the number of the last pair.
        """
        while True:
            found = self._gossip.database.numbered_since(sequence, limit)
            messages = ((number, message_of(record, self.team)) for number, record in found)
            ours = [(number, message) for number, message in messages if message]
            if ours or not found:
                return ours
            sequence = found[-1][0]

    @property
    def storage_fault(self) -> str | None:
        """Why the node cannot write messages to disk now; None: it can, or it has no `storage`."""
        fault = self._storage.fault if self._storage else None
        return str(fault) if fault else None

    def links(self) -> dict[str, LinkMetrics]:
        """The state of the link to every peer, by its name."""
        ages_s = self._gossip.ages_s(self._now())  # may be thousands: computed without the lock
        with self._lock:
            return self._gossip.links(self._now(), ages_s)

    def held(self, peer: str) -> dict[tuple[str, str], float]:
        """The messages that a peer is known to hold.

        The peer has announced these messages, or has sent them to this node. Messages that the peer
        pulled from this node are not included. Original nodes announce nothing.

        Args:
            peer: the name of a linked robot.

        Returns:
            By robot and topic, the newest stamp in Unix seconds.

        Raises:
            UnknownRobotError: the peer is not linked to this robot.
        """
        with self._lock:
            newest = self._gossip.held(peer)
        known = ((self.team.topics_by_key.get(key), stamp) for key, stamp in newest.items())
        return {(of[0].name, of[1].name): stamp / 1000 for of, stamp in known if of}

    def subscribe(self, callback: Callable[[LinkEvent], None]) -> Callable[[], None]:
        """Call a function on the node's thread for every event.

        The callback must be quick, as the node does nothing else meanwhile. It may call any method
        of the node. The node logs an exception of the callback and keeps running.

        Args:
            callback: takes the event.

        Returns:
            A function that ends the subscription.

        Raises:
            TypeError: the callback cannot be called, or is a coroutine function.
        """
        return self._broadcast.subscribe(callback)

    def events(self) -> EventStream:
        """An asynchronous iterator over every event from now on, until the node closes.

        Returns:
            The stream. A slow reader loses the oldest events; `dropped` counts them.
        """
        return self._broadcast.stream()

    def wait_for(
        self,
        kind: type[_Event],
        condition: Callable[[_Event], bool] | None = None,
        *,
        timeout_s: float | None = None,
    ) -> Coroutine[Any, Any, _Event]:
        """Wait in asyncio for the next event of a kind.

        Events count from this call on, not from the ``await``. To miss none, call it before the
        action that causes the event, and await the result afterwards.

        Args:
            kind: the class of the event, e.g. SyncEnded.
            condition: only events for which it is true; called on the event loop.
            timeout_s: real seconds, counted from the ``await``; default: no limit.

        Returns:
            A coroutine; its result is the event.

        Raises:
            TimeoutError: no such event occurred in time.
            NodeClosedError: the node was closed before.
        """
        return self._next(self._broadcast.stream(kind=kind), kind, condition, timeout_s)

    async def _next(
        self,
        stream: EventStream,
        kind: type[_Event],
        condition: Callable[[_Event], bool] | None,
        timeout_s: float | None,
    ) -> _Event:
        async with asyncio.timeout(timeout_s):
            async for event in stream:
                if isinstance(event, kind) and (condition is None or condition(event)):
                    return event
        raise NodeClosedError(f"the node of {self.name} was closed before the {kind.__name__}")

    def sync(self, peer: str, *, both: bool = False) -> bool:
        """Pull from a peer now.

        Args:
            peer: the name of a linked robot.
            both: request that the peer also pulls from this node within the interval; the peer must
                run a new node. Without it the peer pulls when its own timer expires, which is rare
                while this node pushes everything it stores.

        Returns:
            Whether a pull began; False if a pull from the peer is in progress, or the node has not
            been started.

        Raises:
            UnknownRobotError: the peer is not linked to this robot.
            NodeClosedError: the node is closed.
        """
        self._check_open()
        if self._transport is None and peer in self.robot.peers:
            return False
        with self._lock:
            started = self._gossip.sync(peer, self._now(), both=both)
        self._wake()
        return started

    def _signal_received(self, peer: str, reading: Reading | float | None) -> None:
        with self._lock:
            self._gossip.signal_received(peer, reading, self._now())
        self._wake()

    def _fault(self, fault: StorageError | None) -> None:
        at_s = self.clock.now_s()
        failed = fault and StorageFailed(self.name, at_s, str(fault))
        event = failed or StorageRecovered(self.name, at_s)
        with self._lock:
            if self._early is not None:
                self._early.append(event)
                return
            self._gossip.announce(event)
        self._wake()

    def _now(self) -> Instant:
        return _instant(self.clock)

    def _wake(self) -> None:
        if self._transport:
            self._transport.wake()

    def _check_open(self) -> None:
        if self._closed:
            raise NodeClosedError(f"the node of {self.name} is closed; make a new one")


def _instant(clock: Clock) -> Instant:
    return Instant(clock.now_s(), time.monotonic(), isinstance(clock, SystemClock))


def _weakly(method: Callable[_Given, None]) -> Callable[_Given, None]:
    """Wrap a method so that other threads may hold it without keeping its object alive."""
    weak = WeakMethod(method)

    def call(*args: _Given.args, **more: _Given.kwargs) -> None:
        found = weak()
        if found:
            found(*args, **more)

    return call
