"""The pace of the world over TCP: the process that sets it, and other vehicles that follow it."""

import json
import logging
import math
import socket
import time
from collections.abc import Collection
from typing import Any, Final

from air_router.vehicle import PACE_ALLOWANCE_S, PaceSource, line
from sitl.process.pace import PATIENCE_S, STALLED_SPEED, STARTING_SPEED, Limit, Pace
from sitl.process.vehicle import Address, PortInUseError

_log = logging.getLogger(__name__)

_READ: Final = 4096
_LONGEST: Final = 1000  # bytes of a line; a peer that sends more is not one of ours
_AGAIN_S: Final = 0.1  # between two attempts to connect

_NOT_OURS: Final = (ValueError, KeyError, TypeError, OverflowError, RecursionError)
"""What is raised for a line of another program."""


def _received(unread: bytes) -> tuple[list[Any], bytes]:
    """The newest message, if one is complete, and the begun line.

    Raises:
        ValueError, RecursionError: it is no message of ours.
    """
    *whole, rest = unread.split(b"\n")
    if max(map(len, (*whole, rest))) > _LONGEST:
        raise ValueError("a line is too long")
    return [json.loads(text) for text in whole[-1:]], rest


class PaceServer(Pace):
    """Where the processes of a world connect; see `air_router.vehicle.pace` for their messages.

    A vehicle that follows sends `follows` as well, and is sent the limit.

    Args:
        bind: Host and port to listen on; port 0 takes a free one.
        expected: How many processes will take part.

    Raises:
        PortInUseError: the port is taken.
    """

    def __init__(self, bind: Address, expected: int) -> None:
        super().__init__(expected)
        self._unread: dict[socket.socket, bytes] = {}  # by connection: the begun line
        self._names: dict[socket.socket, str] = {}  # by connection: the name that it reports
        self._followers: set[socket.socket] = set()  # vehicles that want the limit
        self._last: Limit | None = None  # that was sent to the followers
        try:
            self._listener = socket.create_server(bind)
        except OSError as error:
            raise PortInUseError(
                f"pace: cannot use TCP port {bind[1]}: {error.strerror}; another simulation runs "
                "on it: end that, or choose another --pace"
            ) from None
        self._listener.setblocking(False)

    @property
    def port(self) -> int:
        """The port it listens on."""
        return int(self._listener.getsockname()[1])

    @property
    def sockets(self) -> Collection[socket.socket]:
        """See `Pace.sockets`."""
        return (self._listener, *self._unread)

    def attend(self, ready: Collection[object]) -> bool:
        """See `Pace.attend`."""
        if self._listener in ready:
            self._accept()
        come = [client for client in self._unread if client in ready]
        for client in come:
            self._read(client)
        return bool(come)

    def limit(self, time_s: float, wall_s: float, received_s: float = math.inf) -> Limit:
        """See `Pace.limit`; sends it to the followers."""
        limit = super().limit(time_s, wall_s, received_s)
        if self._followers:
            self._send(Limit(min(time_s + PACE_ALLOWANCE_S, limit.until_s), limit.most_speed))
        return limit

    def close(self) -> None:
        """Free the port; no process is waited for any more."""
        self._listener.close()
        for client in tuple(self._unread):
            self._drop(client)

    def _accept(self) -> None:
        try:
            client, _ = self._listener.accept()
        except OSError:
            return  # it has left again
        client.setblocking(False)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._unread[client] = b""
        self.joined(client)

    def _read(self, client: socket.socket) -> None:
        try:
            chunk = client.recv(_READ)
        except BlockingIOError:
            return
        except OSError:
            chunk = b""
        try:
            messages, self._unread[client] = _received(self._unread[client] + chunk)
            for fields in messages:
                self._take(client, fields)
        except _NOT_OURS:
            _log.warning("what was received on the port of the pace is none of it: hung up")
            chunk = b""
        if not chunk:
            self._drop(client)

    def _take(self, client: socket.socket, fields: Any) -> None:
        name, time_s = str(fields["name"]), float(fields["reached_s"])
        if not math.isfinite(time_s):
            raise ValueError("no time")
        if self._names.setdefault(client, name) != name:
            raise ValueError("another name")
        self.reached(client, name, time_s, time.monotonic())
        if fields.get("follows"):
            self._followers.add(client)

    def _drop(self, client: socket.socket) -> None:
        del self._unread[client]
        self._names.pop(client, None)
        self._followers.discard(client)
        self.left(client)
        client.close()

    def _send(self, limit: Limit) -> None:
        if limit == self._last:
            return
        self._last = limit
        sent = line({"until_s": round(limit.until_s, 3), "most_speed": limit.most_speed})
        for client in tuple(self._followers):
            try:
                whole = client.send(sent) == len(sent)  # else the next line would not be one
            except BlockingIOError:
                continue  # it has not read the last thousand yet
            except OSError:
                whole = False
            if not whole:
                self._drop(client)


class FollowedPace(Pace):
    """Of a vehicle that follows the clock of another one; without that it runs on by itself.

    Args:
        source: Where the other one sets the pace.
        name: Of the vehicle.
    """

    def __init__(self, source: PaceSource, name: str) -> None:
        super().__init__()
        self._source = source
        self._name = name
        self._socket: socket.socket | None = None  # None: not connected yet, or not any more
        self._again_s = 0.0  # wall time of the next attempt to connect
        self._unread = b""  # the begun line
        self._limit = Limit(most_speed=STARTING_SPEED)
        self._sent_s = -math.inf  # time of our clock that was sent last
        self._limit_received_s = 0.0  # wall time of the last limit that came
        self._ended = False  # the other one has left: free for good

    @property
    def sockets(self) -> Collection[socket.socket]:
        """See `Pace.sockets`."""
        return () if self._socket is None else (self._socket,)

    def attend(self, ready: Collection[object]) -> bool:
        """See `Pace.attend`."""
        if self._socket is None or self._socket not in ready:
            return False
        try:
            chunk = self._socket.recv(_READ)
        except BlockingIOError:
            return False
        except OSError:
            chunk = b""
        if not chunk:
            self.close()
            return True
        try:
            messages, self._unread = _received(self._unread + chunk)
            for fields in messages:
                self._limit = _limit_of(fields)
                self._limit_received_s = time.monotonic()
        except _NOT_OURS:
            _log.warning("%s does not set the pace of a world: it is not followed", self._source)
            self.close()
            return True
        return bool(messages)

    def limit(self, time_s: float, wall_s: float, received_s: float = math.inf) -> Limit:
        """See `Pace.limit`; reports to the other one how far we are."""
        free = super().limit(time_s, wall_s, received_s)
        if self._ended:
            return free
        self._send(time_s, wall_s)
        if time_s >= self._limit.until_s and wall_s - self._limit_received_s > PATIENCE_S:
            return Limit(most_speed=STALLED_SPEED)
        return self._limit

    def close(self) -> None:
        """Follow no more."""
        self._ended = True
        self._limit = Limit()
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _send(self, time_s: float, wall_s: float) -> None:
        try:
            if self._socket is None:
                if wall_s < self._again_s:
                    return
                self._again_s = wall_s + _AGAIN_S
                self._socket = self._source.connect()
            if time_s != self._sent_s:
                self._sent_s = time_s
                fields = {"name": self._name, "reached_s": round(time_s, 3), "follows": True}
                sent = line(fields)
                if self._socket.send(sent) < len(sent):  # the next line would not be one
                    self.close()
        except (BlockingIOError, ConnectionRefusedError):
            pass  # it has a thousand of ours to read, or is about to begin
        except OSError:
            self.close()


def _limit_of(fields: Any) -> Limit:
    """The limit in a message. Raises one of `_NOT_OURS`."""
    limit = Limit(float(fields["until_s"]), float(fields["most_speed"]))
    if math.isnan(limit.until_s) or not limit.most_speed > 0:
        raise ValueError("no limit")
    return limit
