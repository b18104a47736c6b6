"""Sends requests to other programs and follows them, in JSON over ZeroMQ: above all a node.

`ServiceClient` sends requests to a node (``mocha-link node --serve``), `watch` follows its metrics
(``--metrics``). Made to be used by any Python from 3.8 on that has `pyzmq`, e.g. that of a ROS
installation: it imports nothing else of others, and nothing of the node.
"""

from __future__ import annotations

import json
import time
from abc import abstractmethod
from collections.abc import Iterator
from typing import Any, ClassVar

import zmq

from mocha_link.errors import MochaLinkError, RequestError
from mocha_link.forks import parents_only
from mocha_link.lifetime import Closeable
from mocha_link.service.endpoint import EndpointError, connect, folder

MAX_MESSAGE_BYTES = 64 * 1024 * 1024  # a snapshot of 255 links with all their topics is 8 MB

TEXT = "std_msgs/String"
"""The type of ROS in which bridges carry JSON."""

RECONNECT_S = 0.05
"""Interval between attempts to connect to a server that has not started yet."""


class ServiceError(RequestError):
    """The node refused a request, and why. `again`: the request may succeed later."""


class ServiceUnreachableError(MochaLinkError):
    """No program serves the endpoint, or the program is not a node."""


class MetricsError(MochaLinkError):
    """No metrics were received from an endpoint."""


class _Connection(Closeable):
    """A socket to an endpoint; the program there may start later, and may restart."""

    unreachable: ClassVar[type[Any]]
    """The error of an invalid endpoint, an absent server, or a wrong one."""

    def __init__(self, endpoint: str) -> None:
        self.endpoint = endpoint
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()  # of its socket
        self._socket: zmq.Socket[bytes] | None = None  # None: not connected yet, or hung up
        try:
            self._connected(0.0)
        except BaseException:
            self.close()
            raise
        parents_only(self)

    @abstractmethod
    def _made(self, context: zmq.Context[zmq.Socket[bytes]]) -> zmq.Socket[bytes]:
        """The socket to connect, with its options."""

    def close(self) -> None:
        """Give up the connection; may be called twice."""
        self._hang_up()
        self._context.term()

    def _connected(self, until_s: float) -> zmq.Socket[bytes] | None:
        """The connection; None if until then no program has left a key of the endpoint."""
        while self._socket is None:
            socket = self._made(self._context)
            socket.setsockopt(zmq.LINGER, 0)
            try:
                if connect(socket, self.endpoint):
                    self._socket = socket
            except EndpointError as error:
                raise self.unreachable(str(error)) from None
            finally:
                if self._socket is None:
                    socket.close()
            left_s = until_s - time.monotonic()
            if self._socket is not None or left_s <= 0:
                break
            time.sleep(min(RECONNECT_S, left_s))
        return self._socket

    def _hang_up(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None


class EndpointClient(_Connection):
    """The client of a request endpoint. One thread may use it; a context manager.

    A server may come back: every request tries to connect again.

    Args:
        endpoint: the address of the server, ``tcp://127.0.0.1:port`` or ``ipc://path``.
        timeout_s: seconds to wait for a reply, on top of `wait_s` of the request.

    Raises:
        MochaLinkError: the endpoint is invalid; the class is `unreachable` of the subclass.
    """

    server_kind: ClassVar[str]
    """The kind of server, as in "is not a node"."""
    server_option: ClassVar[str]
    """The command line option of the server for this endpoint."""
    refused: ClassVar[type[Any]]
    """What is raised when a request is refused; its `again`: it may be taken later."""

    def __init__(self, endpoint: str, *, timeout_s: float = 5.0) -> None:
        self._timeout_s = timeout_s
        self._number = 0  # of the latest request
        super().__init__(endpoint)

    def call(
        self, request: dict[str, Any], data: bytes | None = None, *, wait_s: float = 0.0
    ) -> tuple[dict[str, Any], list[bytes]]:
        """Send a request, and wait for its reply.

        Args:
            request: the fields; those of value None are left out.
            data: a binary frame after the fields; None: no frame.
            wait_s: seconds that the server itself may take.

        Returns:
            The fields of the reply, and the data frames after them.

        Raises:
            MochaLinkError: as `refused` (the server refused) or `unreachable` (no reply in time).
        """
        self._number += 1
        sent = {key: value for key, value in request.items() if value is not None}
        sent["id"] = self._number
        frames = [json.dumps(sent).encode()] + ([] if data is None else [data])
        until_s = time.monotonic() + self._timeout_s + wait_s
        socket = self._connected(until_s)
        if socket is None:
            raise self.unreachable(
                f"no key of {self.endpoint} in {folder()}; is a {self.server_kind} running "
                f"there with {self.server_option} {self.endpoint}, started by you?"
            )
        try:
            socket.send_multipart(frames, zmq.NOBLOCK)
            while True:
                left_ms = int((until_s - time.monotonic()) * 1000)
                if left_ms <= 0 or not socket.poll(left_ms):
                    break
                head, *parts = socket.recv_multipart()
                values = json.loads(head)
                if values.get("id") not in (self._number, None):
                    continue  # to a request that we gave up
                if values["ok"]:
                    return values, parts
                raise self.refused(str(values["error"]), again=values.get("again") is True)
        except zmq.ZMQError:
            pass  # its queue is full: it has not been there for long
        except (ValueError, LookupError, AttributeError, TypeError, RecursionError):
            raise self.wrong_server() from None
        self._hang_up()
        limit_s = self._timeout_s + wait_s
        raise self.unreachable(
            f"no answer from {self.endpoint} within {limit_s:g} s; is a {self.server_kind} "
            f"running there with {self.server_option} {self.endpoint}?"
        )

    def wrong_server(self) -> Exception:
        """Disconnect and return the error to raise: another program serves the endpoint."""
        self._hang_up()
        error: Exception = self.unreachable(
            f"the program at {self.endpoint} is not a {self.server_kind}"
        )
        return error

    def _made(self, context: zmq.Context[zmq.Socket[bytes]]) -> zmq.Socket[bytes]:
        return context.socket(zmq.DEALER)


class ServiceClient(EndpointClient):
    """Sends requests to one node. One thread may use it; a context manager.

    Args:
        endpoint: the ``--serve`` endpoint of the node.
        timeout_s: seconds to wait for a reply, on top of `wait_s` of a request.

    Raises:
        ServiceUnreachableError: the endpoint is invalid.
    """

    server_kind, server_option = "node", "--serve"
    refused, unreachable = ServiceError, ServiceUnreachableError

    def publish(
        self,
        topic: str,
        data: bytes,
        *,
        now: bool = False,
        ros: int | None = None,
        key: str | None = None,
    ) -> str:
        """Publish a message of the node's robot.

        Args:
            topic: the name of a topic of the robot.
            data: the payload.
            now: publish at once, whatever `min_interval_s` of the topic is.
            ros: the ROS version (1 or 2) of the serialization; default: that of the robot.
            key: an id of the request; the node executes requests of one key once.

        Returns:
            The header of the message, in hex digits.

        Raises:
            ServiceError: the node refused.
            ServiceUnreachableError: no reply in time.
        """
        fields: dict[str, Any] = {"topic": topic, "now": now, "ros": ros, "key": key}
        return str(self.request("publish", data, **fields)[0].get("header"))

    def latest(
        self, robot: str, topic: str, *, ros: int | None = None
    ) -> tuple[dict[str, Any], bytes] | None:
        """The newest message of a topic.

        Args:
            robot: the name of the robot that published it.
            topic: the name of the topic.
            ros: the ROS version to convert to; default: as published.

        Returns:
            The fields of the message and its payload; None if the node has none.

        Raises:
            ServiceError: the node refused.
            ServiceUnreachableError: no reply in time.
        """
        fields, parts = self.request("latest", robot=robot, topic=topic, ros=ros)
        return (fields["message"], parts[0]) if fields.get("message") and parts else None

    def messages(self, robot: str | None = None) -> list[dict[str, Any]]:
        """The fields of the newest message of every topic, without payloads.

        Args:
            robot: of this robot only; None: of all robots.

        Raises:
            ServiceError: the node refused.
            ServiceUnreachableError: no reply in time.
        """
        found: list[dict[str, Any]] = self.request("list", robot=robot)[0].get("messages", [])
        return found

    def since(
        self,
        place: tuple[str, int] | None = None,
        *,
        limit: int = 100,
        wait_s: float = 0.0,
        own: bool = False,
        ros: int | None = None,
    ) -> tuple[tuple[str, int], list[tuple[dict[str, Any], bytes]]]:
        """The messages that were stored after a position in the sequence.

        A program that stores the position misses no message. After a restart of the node the
        sequence begins again, with every message that the node holds.

        Args:
            place: the position (epoch, sequence) of the previous call; None: from the beginning.
            limit: at most so many messages, 1 to 1000.
            wait_s: seconds to wait if there is no message yet.
            own: include messages of the node's own robot.
            ros: the ROS version to convert to; default: as published.

        Returns:
            The position for the next call, and pairs of message fields and payload.

        Raises:
            ServiceError: the node refused.
            ServiceUnreachableError: no reply in time, or an invalid one.
        """
        epoch, sequence = place or (None, 0)
        fields, parts = self.request(
            "since",
            epoch=epoch,
            sequence=sequence,
            limit=limit,
            wait_s=wait_s,
            own=own,
            ros=ros,
        )
        try:
            messages = list(zip(fields["messages"], parts))  # noqa: B905 - Python 3.8
            return (fields["epoch"], fields["sequence"]), messages
        except (LookupError, TypeError):
            raise self.wrong_server() from None

    def team(self) -> dict[str, Any]:
        """The robot of the node, and the robots, topics and types of its team.

        Raises:
            ServiceUnreachableError: no reply in time.
        """
        return self.request("team")[0]

    def links(self) -> dict[str, Any]:
        """The metrics of every link: `robot`, `at_s`, and `links` by peer (docs/embedding.md).

        Raises:
            ServiceUnreachableError: no reply in time.
        """
        return self.request("links")[0]

    def request(
        self, name: str, data: bytes | None = None, **fields: object
    ) -> tuple[dict[str, Any], list[bytes]]:
        """Send a request of any verb.

        Args:
            name: the verb.
            data: a binary frame after the fields; None: no frame.
            fields: the fields of the request; `wait_s` extends the time-out.

        Returns:
            The fields of the reply, and the data frames after them.

        Raises:
            ServiceError: the node refused.
            ServiceUnreachableError: no reply in time.
        """
        wait = fields.get("wait_s")
        wait_s = wait if isinstance(wait, (int, float)) else 0.0
        return self.call({"request": name, **fields}, data, wait_s=wait_s)


def split(about: dict[str, Any], data: bytes) -> list[bytes]:
    """Split the payload of a message whose topic has `aggregate`.

    Args:
        about: the fields of the message.
        data: its payload.

    Returns:
        The payloads of the batch; without `aggregate` the payload alone.
    """
    if "parts" not in about:
        return [data]
    parts = []
    start = 0
    for size in about["parts"]:
        parts.append(data[start : start + size])
        start += size
    return parts


class Subscription(_Connection):
    """Receives the metrics of a node, beginning with a snapshot. Use as a context manager.

    Args:
        endpoint: the ``--metrics`` endpoint of the node.

    Raises:
        MetricsError: the endpoint is invalid.
    """

    unreachable = MetricsError

    def next(self, timeout_s: float) -> tuple[str, dict[str, Any]] | None:
        """The next message.

        Args:
            timeout_s: real seconds to wait for it.

        Returns:
            ("links", snapshot) or ("event", event); None if nothing was received in time.

        Raises:
            MetricsError: the message is not a node's metrics.
        """
        until_s = time.monotonic() + timeout_s
        socket = self._connected(until_s)
        if socket is None or not socket.poll(max(0, int((until_s - time.monotonic()) * 1000))):
            return None
        frames = socket.recv_multipart()
        try:
            kind, fields = frames[0].decode(), json.loads(frames[1])
        except (ValueError, IndexError, RecursionError):
            raise self.malformed() from None
        if not isinstance(fields, dict):
            raise self.malformed()
        return kind, fields

    def malformed(self) -> MetricsError:
        """The error for a message that is not a node's metrics."""
        return MetricsError(f"what {self.endpoint} sends is not a node's metrics")

    def silent(self, timeout_s: float) -> MetricsError:
        """The error for an endpoint that sent nothing in time.

        Args:
            timeout_s: the real seconds that have passed.
        """
        return MetricsError(
            f"nothing from {self.endpoint} for {timeout_s:g} s; is a node running there with "
            f"--metrics {self.endpoint}?"
        )

    def _made(self, context: zmq.Context[zmq.Socket[bytes]]) -> zmq.Socket[bytes]:
        socket = context.socket(zmq.SUB)
        socket.setsockopt(zmq.MAXMSGSIZE, MAX_MESSAGE_BYTES)
        socket.setsockopt(zmq.SUBSCRIBE, b"")
        return socket


def watch(endpoint: str, *, timeout_s: float = 5.0) -> Iterator[tuple[str, dict[str, Any]]]:
    """Receive a node's metrics: ("links", snapshot) first, then events and snapshots.

    Args:
        endpoint: the ``--metrics`` endpoint of the node.
        timeout_s: real seconds without a message after which it fails.

    Raises:
        MetricsError: the endpoint sent nothing for `timeout_s`, or something that is not a node's
            metrics.
    """
    with Subscription(endpoint) as subscription:
        while received := subscription.next(timeout_s):
            yield received
        raise subscription.silent(timeout_s)
