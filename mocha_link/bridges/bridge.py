"""Carries messages between a node's service and another middleware, in both directions.

Messages of the middleware on the robot's own topics are published through the node; messages of
other robots are published to the middleware under ``/<robot>/<topic>``. Messages wait for
whichever side is away; one that cannot be published is logged and skipped.
"""

from __future__ import annotations

import contextlib
import logging
import re
import threading
import time
import uuid
from collections import Counter, deque
from collections.abc import Callable
from typing import Any, Protocol

from mocha_link.bridges.progress import Progress
from mocha_link.errors import install_command
from mocha_link.service import (
    TEXT,
    ServiceClient,
    ServiceError,
    ServiceUnreachableError,
    split,
)

WAIT_S = 1.0  # of a request for new messages
DRAIN_S = 30.0  # at its end the bridge publishes queued messages while the node replies
PAUSE_S = 0.5  # before a request to an absent node is repeated
QUIET_TOPIC_S = 20.0  # silence of a topic until a warning
MAX_QUEUED = 1000  # messages of the robot that wait for the node
MAX_QUEUED_BYTES = 64 * 1024 * 1024
JSON_PACKAGE = "json/"

LOG = logging.getLogger("mocha_link")


class Middleware(Protocol):
    """What a bridge needs of the other side. `ros` is how it serializes messages."""

    ros: int

    def subscribe(self, topic: str, kind: str, history: int, take: Callable[[bytes], None]) -> None:
        """Call `take` with each serialized message of a topic, from any thread.

        Raises any exception.
        """

    def publish(self, topic: str, kind: str, history: int, data: bytes) -> None:
        """Publish a serialized message. Raises any exception."""

    def text(self, data: bytes) -> bytes:
        """UTF-8 text as a serialized std_msgs/String."""

    def from_text(self, data: bytes) -> bytes:
        """The UTF-8 text in a serialized std_msgs/String. Raises ValueError."""

    def watch(self, wait: Callable[[float], bool]) -> str | None:
        """Why a bridge must end without a request; None when `wait` ends it."""

    def close(self) -> None:
        """Give up everything."""


class PublishQueue:
    """Messages of the robot on their way to the node, in order; a full queue drops the oldest."""

    def __init__(self) -> None:
        self._queued: deque[tuple[str, bytes]] = deque()  # topic, data
        self._size = 0  # bytes held
        self._changed = threading.Condition()  # a message came, or it ends
        self.dropped = 0  # messages given up

    def put(self, topic: str, data: bytes) -> None:
        """Add a message, from any thread."""
        with self._changed:
            queued = self._queued
            queued.append((topic, data))
            self._size += len(data)
            while len(queued) > 1 and (len(queued) > MAX_QUEUED or self._size > MAX_QUEUED_BYTES):
                if not self.dropped:
                    LOG.warning("too much waits for the node: the oldest are given up")
                self.dropped += 1
                self._size -= len(queued.popleft()[1])
            self._changed.notify()

    def first(self, timeout_s: float) -> tuple[str, bytes] | None:
        """The oldest message, which stays until `done`."""
        with self._changed:
            return (
                self._queued[0] if self._changed.wait_for(lambda: self._queued, timeout_s) else None
            )

    def done(self, message: tuple[str, bytes]) -> None:
        """A message has left."""
        with self._changed:
            if self._queued and self._queued[0] is message:
                self._size -= len(self._queued.popleft()[1])


class _Outage:
    """Whether a thread waits for the node; logged once for all threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._waiting: set[int] = set()  # threads of which no request was answered since

    @property
    def here(self) -> bool:
        """Whether this thread waits."""
        return threading.get_ident() in self._waiting

    def began(self, error: Exception) -> None:
        """A request of this thread was not answered."""
        with self._lock:
            if not self._waiting:
                LOG.warning("waiting for the node: %s", error)
            self._waiting.add(threading.get_ident())

    def ended(self) -> None:
        """A request of this thread was answered."""
        with self._lock:
            if threading.get_ident() in self._waiting:
                self._waiting.remove(threading.get_ident())
                if not self._waiting:
                    LOG.warning("the node answers again")


class Bridge:
    """Runs between the node at an endpoint and a middleware until it is stopped.

    The node is away when it has not replied for `patience_s`; `clock` has seconds.
    """

    def __init__(
        self,
        endpoint: str,
        middleware: Middleware,
        progress: Progress,
        *,
        patience_s: float = 5.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.endpoint = endpoint
        self._patience_s = patience_s
        self._middleware = middleware
        self._progress = progress
        self._clock = clock
        # By subscribed topic of which no message was received: its type.
        self._quiet: dict[str, str] = {}
        self._publish_queue = PublishQueue()
        self._stopping = threading.Event()
        self._complaints: Counter[str] = Counter()  # by subject: the first is a warning
        self._outage = _Outage()  # of the node

    def stop(self) -> None:
        """Let `run` end, from any thread or a signal handler."""
        self._stopping.set()

    def run(self) -> None:
        """Carry messages until `stop`."""
        with ServiceClient(self.endpoint, timeout_s=self._patience_s) as client:
            team = self._retry(client.team)
            if team is None:
                return
            self._subscribe(team)
            outgoing = threading.Thread(target=self._send, name="bridge out", daemon=True)
            outgoing.start()
            quiet_s = self._clock() + QUIET_TOPIC_S
            LOG.info("ready: the bridge of %s", team["robot"])
            try:
                self._follow(client, team, quiet_s)
            finally:
                self._stopping.set()
                for _ in range(int(DRAIN_S / PAUSE_S)):
                    if not self._outage.here:
                        outgoing.join(PAUSE_S)

    def _subscribe(self, team: dict[str, Any]) -> None:
        for topic in team["robots"][team["robot"]]["topics"]:
            name, kind = topic["name"], topic["type"]
            carried = self._carried(kind, team, logging.WARNING)
            if carried is None:
                continue

            def take(data: bytes, name: str = name, kind: str = kind) -> None:
                if self._stopping.is_set():  # a robot that keeps publishing would never let it end
                    return
                self._quiet.pop(name, None)
                try:
                    plain = kind.startswith(JSON_PACKAGE)
                    self._publish_queue.put(
                        name, self._middleware.from_text(data) if plain else data
                    )
                except ValueError as error:
                    self._complain(name, f"not published: {error}")

            try:
                self._quiet[name] = carried
                self._middleware.subscribe(channel(name), carried, topic["history"], take)
            except Exception as error:  # noqa: BLE001 - whatever a middleware raises
                self._quiet.pop(name, None)
                self._complain(name, f"cannot be subscribed: {error}")

    def _carried(self, kind: str, team: dict[str, Any], level: int) -> str | None:
        """The type of the middleware that carries a type of the team's; one without is logged."""
        if kind.startswith(JSON_PACKAGE):
            return TEXT
        ros = self._middleware.ros
        if ros in team["types"].get(kind, {}).get("ros", ()):
            return kind
        why = f"is not bridged: no type of ROS {ros}, nor one of the team's definitions"
        if not team.get("has_ros", True):
            why = f"is unknown to the node: it needs the extra 'ros', {install_command('ros')}"
            level = logging.WARNING
        self._complain(kind, why, level)
        return None

    def _follow(self, client: ServiceClient, team: dict[str, Any], quiet_s: float) -> None:
        """Publish messages of other robots; warn of topics that are silent after `quiet_s`."""
        histories = {
            (robot, topic["name"]): topic["history"]
            for robot, about in team["robots"].items()
            for topic in about["topics"]
        }
        while not self._stopping.is_set():
            if self._quiet and self._clock() >= quiet_s:
                quiet = self._quiet.copy()  # in one step: the middleware's threads remove topics
                topics = ", ".join(f"{name} ({kind})" for name, kind in quiet.items())
                need = "publishers need these names and types, and this domain or master"
                LOG.info("no message on %s yet: %s", topics, need)
                self._quiet = {}
            found = self._retry(
                lambda: client.since(self._progress.place, wait_s=WAIT_S, ros=self._middleware.ros)
            )
            if found is None:
                return
            place, messages = found
            for about, data in messages:
                if self._stopping.is_set():
                    return
                history = histories.get((about["robot"], about["topic"]), 1)
                self._publish(about, data, history, team)
            if place != self._progress.place:
                self._progress.move(place)

    def _publish(
        self, about: dict[str, Any], data: bytes, history: int, team: dict[str, Any]
    ) -> None:
        """Publish a message of another robot to the middleware, unless it was before."""
        name = channel(f"/{about['robot']}/{about['topic']}")
        if self._progress.published(name, about["header"]):
            return
        kind = self._carried(about["type"], team, logging.INFO)  # programs may want it
        if "error" in about:
            self._complain(name, f"skipped: {about['error']}")
        elif kind is not None:
            try:
                for part in split(about, data):
                    plain = about["type"].startswith(JSON_PACKAGE)
                    body = self._middleware.text(part) if plain else part
                    self._middleware.publish(name, kind, history, body)
            except Exception as error:  # noqa: BLE001 - whatever a middleware raises
                self._complain(name, f"skipped: {error}")
        self._progress.note(name, about["header"], history)

    def _send(self) -> None:
        """Publish messages of the robot through the node."""
        with ServiceClient(self.endpoint, timeout_s=self._patience_s) as client:
            while (message := self._publish_queue.first(WAIT_S)) or not self._stopping.is_set():
                if message is None:
                    continue
                topic, data = message
                key = uuid.uuid4().hex
                with contextlib.suppress(_GivenUpError):
                    header = self._retry(
                        lambda: client.publish(topic, data, ros=self._middleware.ros, key=key),  # noqa: B023
                        topic,
                    )
                    if header is None:
                        return
                self._publish_queue.done(message)

    def _retry(self, request: Callable[[], Any], about: str = "") -> Any:
        """The reply to a request, repeated until the node replies.

        When stopping, one try or None.
        """
        while True:
            try:
                reply = request()
            except ServiceUnreachableError as error:
                self._outage.began(error)
            except ServiceError as error:
                self._outage.ended()
                self._complain(about, f"the node refused: {error}")
                if about and not error.again:
                    raise _GivenUpError from None
            else:
                self._outage.ended()
                return reply
            if self._stopping.wait(PAUSE_S):
                return None

    def _complain(self, about: str, what: str, level: int = logging.WARNING) -> None:
        """Log, loudly the first time."""
        self._complaints[about] += 1
        LOG.log(level if self._complaints[about] == 1 else logging.DEBUG, "%s %s", about, what)


class _GivenUpError(Exception):
    """The node has refused a message for good."""


def channel(name: str) -> str:
    """A name as ROS allows it: other characters become ``_``, none begins with a digit."""
    parts = (re.sub(r"[^A-Za-z0-9_]", "_", part) for part in name.split("/") if part)
    return "/" + "/".join(f"_{part}" if part[0].isdigit() else part for part in parts)
