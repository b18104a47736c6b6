"""Who is connected to an open port, and how much they have sent: no peer may fill our memory.

libzmq keeps the parts of a message until its last part has come, however many there are, and takes
in any number of connections. Nodes make a connection for one pull, or for one request, so a peer
that brings more than a pull can is sent away. Ports that need a key do not need this.
"""

from __future__ import annotations

import contextlib
import logging
import socket
from collections.abc import Iterator

import zmq
from zmq.utils.monitor import parse_monitor_message

from mocha_link.node.kernel import borrowed, bytes_received

MAX_BYTES = 16 * 1024 * 1024  # of one connection
MAX_CONNECTIONS = 32  # beyond that the oldest goes: most of them are of links that broke
_EVENTS = zmq.Event.ACCEPTED | zmq.Event.CLOSED | zmq.Event.DISCONNECTED

LOG = logging.getLogger("mocha_link")


class ConnectionLimiter:
    """Looks after the connections of a ROUTER; call `look` a few times a second."""

    def __init__(self, port: zmq.Socket[bytes], number: int) -> None:
        self._port = port
        self._number = number
        self._monitor = port.get_monitor_socket(int(_EVENTS))
        self._inside: dict[int, None] = {}  # file descriptors of libzmq, the oldest first

    def look(self) -> int:
        """Send away whom it has to; how many there were."""
        for event, fd in self._news():
            self._inside.pop(fd, None)
            if event == zmq.Event.ACCEPTED:
                self._inside[fd] = None
        away = list(self._inside)[: max(len(self._inside) - MAX_CONNECTIONS, 0)]
        away += [fd for fd in self._inside if self._received(fd) > MAX_BYTES]
        for fd in away:
            self._inside.pop(fd, None)
            with borrowed(fd, local=self._number) as connection:
                if connection:
                    with contextlib.suppress(OSError):  # it has gone by itself
                        connection.shutdown(socket.SHUT_RDWR)
        return len(away)

    def close(self) -> None:
        """Before the port is closed."""
        if not self._port.closed:
            self._port.disable_monitor()
        self._monitor.close(0)

    def _received(self, fd: int) -> int:
        with borrowed(fd, local=self._number) as connection:
            return bytes_received(connection) or 0

    def _news(self) -> Iterator[tuple[int, int]]:
        while self._monitor.poll(0):
            event = parse_monitor_message(self._monitor.recv_multipart(zmq.NOBLOCK))
            yield event["event"], event["value"]
