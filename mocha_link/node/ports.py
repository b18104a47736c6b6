"""All ports of a node."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping

from mocha_link.node.kernel import Polled, Poller
from mocha_link.node.link_keys import LinkKeys
from mocha_link.node.port import Port, provide_descriptors
from mocha_link.node.router import IDLE_MS, ClientConnections
from mocha_link.team import Robot

LINK_DESCRIPTORS = 2  # one connection in each direction
OWN_DESCRIPTORS = 16


class Ports:
    """A port for each peer, all with one limit on clients; no ports unless the node `serves`.

    Attributes:
        clients: the connections to all ports.
    """

    def __init__(self, poller: Poller, me: Robot, keys: LinkKeys, *, serves: bool) -> None:
        self.clients = ClientConnections()
        self._poller = poller
        self._me = me
        self._keys = keys
        self._serves = serves
        self._by_peer: dict[str, Port] = {}
        self._unfinished: set[str] = set()  # peers whose ports need another turn at once

    def provide_descriptors(self) -> None:
        """Raises ListenError if the process may not open enough files to accept every peer."""
        each = Port.DESCRIPTORS + LINK_DESCRIPTORS
        provide_descriptors(self._me, OWN_DESCRIPTORS + each * len(self._me.peers))

    def open(self) -> None:
        """Listen for every peer. Raises PortInUseError or ListenError."""
        for peer in self._me.peers if self._serves else ():
            self._by_peer[peer] = Port(self._poller, self.clients, self._me, peer, keys=self._keys)

    def watch(self) -> None:
        """Register all ports with the poller."""
        for port in self:
            port.watch(self._poller)

    def close(self) -> None:
        """Close all at once."""
        for port in self:
            port.close()

    def __iter__(self) -> Iterator[Port]:
        """The open ports."""
        return iter(self._by_peer.values())

    def __getitem__(self, peer: str) -> Port:
        """The port for a peer."""
        return self._by_peer[peer]

    def active(self, ready: Mapping[Polled, Hashable]) -> set[str]:
        """The peers whose ports have a ready socket or unfinished work."""
        return {each.peer for each in ready.values() if isinstance(each, Port)} | self._unfinished

    def of(self, peers: set[str]) -> list[Port]:
        """The open ports for these peers."""
        return [self._by_peer[peer] for peer in peers & self._by_peer.keys()]

    def finished(self, waits_ms: Mapping[str, int]) -> int:
        """Note the wait of each peer's port after its turn; returns the shortest wait."""
        self._unfinished = {peer for peer, wait_ms in waits_ms.items() if wait_ms < IDLE_MS}
        return min(waits_ms.values(), default=IDLE_MS)

    def own_addresses_changed(self) -> None:
        """Close the connections to addresses that this machine no longer has."""
        for port in self:
            port.own_addresses_changed()
