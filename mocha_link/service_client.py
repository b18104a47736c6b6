"""Asks a node's service (``mocha-link node --serve``) from another process.

Made to be used by any Python from 3.8 on that has `pyzmq`, e.g. that of a ROS installation: it
imports nothing else, and nothing of the node.
"""

from __future__ import annotations

import json
import time
from typing import TYPE_CHECKING, Any

import zmq

from mocha_link.errors import MochaLinkError

if TYPE_CHECKING:
    from types import TracebackType
    from typing import Self

    Place = tuple[str, int]  # epoch and sequence number


class ServiceError(MochaLinkError):
    """The node refused a request; it says why. `again`: the same may be taken later."""

    def __init__(self, message: str, *, again: bool = False) -> None:
        super().__init__(message)
        self.again = again


class ServiceUnreachableError(MochaLinkError):
    """Nobody answers at the endpoint, or somebody who is no node."""


class ServiceClient:
    """Asks one node. One thread may use it; a context manager.

    A node that does not answer may come back: every request tries anew.

    Args:
        endpoint: what the node got as ``--serve``.
        timeout_s: how long to wait for an answer, beyond what a request itself wants to wait.

    Raises:
        ServiceUnreachableError: the endpoint is none.
    """

    def __init__(self, endpoint: str, *, timeout_s: float = 5.0) -> None:
        self.endpoint = endpoint
        self._timeout_s = timeout_s
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._socket: zmq.Socket[bytes] | None = None
        self._number = 0
        try:
            self._connected()
        except ServiceUnreachableError:
            self.close()
            raise

    def close(self) -> None:
        """Give up the connection; may be called twice."""
        self._hang_up()
        self._context.term()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def publish(
        self,
        topic: str,
        data: bytes,
        *,
        now: bool = False,
        ros: int | None = None,
        key: str | None = None,
    ) -> str:
        """Publish in the robot's name; returns the header in hex digits.

        `ros` says how the data are serialized, if not as the robot's other ROS messages; a request
        that is repeated with the same `key` publishes once.
        """
        fields: dict[str, Any] = {"topic": topic, "now": now, "ros": ros, "key": key}
        return str(self.request("publish", data, **fields)[0].get("header"))

    def latest(
        self, robot: str, topic: str, *, ros: int | None = None
    ) -> tuple[dict[str, Any], bytes] | None:
        """The newest message of a topic: what is said about it, and its data."""
        fields, parts = self.request("latest", robot=robot, topic=topic, ros=ros)
        return (fields["message"], parts[0]) if fields.get("message") and parts else None

    def messages(self, robot: str | None = None) -> list[dict[str, Any]]:
        """What is said about the newest message of every topic, of all robots or of one."""
        found: list[dict[str, Any]] = self.request("list", robot=robot)[0].get("messages", [])
        return found

    def since(
        self,
        place: Place | None = None,
        *,
        limit: int = 100,
        wait_s: float = 0.0,
        own: bool = False,
        ros: int | None = None,
    ) -> tuple[Place, list[tuple[dict[str, Any], bytes]]]:
        """What was stored after a place in the sequence; waits up to `wait_s` for something.

        Returns the place to ask from next time, and the messages. Whoever remembers the place
        misses nothing. After the node was restarted it begins anew, with everything that it has.
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
            raise self._no_node() from None

    def team(self) -> dict[str, Any]:
        """Which robot this is, and what there is in the team: robots, topics, types."""
        return self.request("team")[0]

    def request(
        self, name: str, data: bytes | None = None, **fields: object
    ) -> tuple[dict[str, Any], list[bytes]]:
        """Ask; returns the answer and the data frames behind it.

        Raises:
            ServiceError: the node refused.
            ServiceUnreachableError: no answer in time.
        """
        self._number += 1
        asked = {"request": name, "id": self._number, **fields}
        asked = {key: value for key, value in asked.items() if value is not None}
        frames = [json.dumps(asked).encode()] + ([] if data is None else [data])
        wait = fields.get("wait_s")
        until_s = (
            time.monotonic() + self._timeout_s + (wait if isinstance(wait, (int, float)) else 0)
        )
        socket = self._connected()
        try:
            socket.send_multipart(frames, zmq.NOBLOCK)
            while True:
                left_ms = int((until_s - time.monotonic()) * 1000)
                if left_ms <= 0 or not socket.poll(left_ms):
                    break
                answer, *parts = socket.recv_multipart()
                values = json.loads(answer)
                if values.get("id") != self._number:
                    continue  # to a request that we gave up
                if values["ok"]:
                    return values, parts
                raise ServiceError(str(values["error"]), again=values.get("again") is True)
        except zmq.ZMQError:
            pass  # its queue is full: it has not been there for long
        except (ValueError, LookupError, AttributeError, TypeError, RecursionError):
            raise self._no_node() from None
        self._hang_up()
        raise ServiceUnreachableError(
            f"no answer from {self.endpoint} within {self._timeout_s:g} s; is a node running there "
            f"with --serve {self.endpoint}?"
        )

    def _connected(self) -> zmq.Socket[bytes]:
        if self._socket is None:
            socket = self._context.socket(zmq.DEALER)
            socket.setsockopt(zmq.LINGER, 0)
            try:
                socket.connect(self.endpoint)
            except zmq.ZMQError as error:
                socket.close()
                raise ServiceUnreachableError(
                    f"'{self.endpoint}' is no endpoint ({zmq.strerror(error.errno or 0)}); write "
                    "ipc://path or tcp://address:port"
                ) from None
            self._socket = socket
        return self._socket

    def _no_node(self) -> ServiceUnreachableError:
        self._hang_up()
        return ServiceUnreachableError(f"what answers at {self.endpoint} is no node")

    def _hang_up(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None


def split(about: dict[str, Any], data: bytes) -> list[bytes]:
    """The messages in the data of one: several if its topic says `aggregate`."""
    if "parts" not in about:
        return [data]
    parts = []
    start = 0
    for size in about["parts"]:
        parts.append(data[start : start + size])
        start += size
    return parts
