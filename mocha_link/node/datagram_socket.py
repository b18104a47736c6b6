"""The socket for datagrams to peers and for their replies."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Container, Iterable, Iterator

import zmq

from mocha_link.hosts import host_of
from mocha_link.logs import NodeLog
from mocha_link.node import kernel
from mocha_link.node.kernel import Polled, Poller
from mocha_link.node.link_keys import LinkKeys
from mocha_link.node.router import BURST
from mocha_link.team import Robot, Team

MAX_PLACES = 1024  # remembered destinations; datagrams from other addresses are ignored


class DatagramSocket:
    """Sends datagrams to the peers' ports for a robot; sends none if it cannot be opened."""

    def __init__(self, team: Team, me: Robot, poller: Poller, keys: LinkKeys) -> None:
        self._team = team
        self._me = me
        self._poller = poller
        self._keys = keys
        self._socket: socket.socket | None = None  # None: not opened, or opening failed
        self._peers_at: dict[tuple[str, int], str] = {}  # by address and port

    def open(self) -> None:
        """Open the socket, if possible."""
        try:
            self._socket = kernel.datagram_socket(self._me.listen)
        except OSError as error:
            NodeLog(self._me.name).warning("no datagrams: %s", error)
        else:
            self._poller.register(self._socket.fileno(), zmq.POLLIN)

    def close(self) -> None:
        """Close the socket."""
        if self._socket:
            self._socket.close()

    def send(self, peer: str, hosts: Iterable[str], packet: bytes) -> None:
        """Send a copy to each address of a peer."""
        if self._socket is None:
            return
        port = self._team.robot(peer).port_for(self._me.name)
        if len(self._peers_at) > MAX_PLACES:
            self._peers_at.clear()
        for host in hosts:
            place = kernel.destination(self._socket, host, port)
            if place:
                self._peers_at[host, port] = peer
                with contextlib.suppress(OSError):  # buffer full or no route: datagrams may be lost
                    self._socket.sendto(self._keys.seal(peer, packet), place)

    def received(self, ready: Container[Polled]) -> Iterator[tuple[str, str, bytes]]:
        """Yield the peers' replies: the peer, its address, and the packet."""
        if self._socket is None or self._socket.fileno() not in ready:
            return
        for packet, source in kernel.received(self._socket, BURST):
            host = host_of(source)
            peer = self._peers_at.get((host, source[1]))
            opened = self._keys.open(peer, packet) if peer else None
            if peer and opened is not None:
                yield peer, host, opened
