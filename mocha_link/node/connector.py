"""Opens connections to peers."""

from __future__ import annotations

import time

from mocha_link.node.connection import Connection
from mocha_link.node.link_keys import LinkKeys
from mocha_link.team import Robot, Team

WAIT_FOR_READY_S = 300.0


class Connector:
    """Opens connections to the peers' ports, and remembers which peers need a slower handshake."""

    def __init__(self, team: Team, me: Robot, keys: LinkKeys) -> None:
        self._team = team
        self._me = me
        self._keys = keys
        self._wait_until_s: dict[str, float] = {}  # by peer: until when requests wait for READY

    def connect(self, peer: str, host: str) -> Connection:
        """Open a connection to an address of a peer. Raises OSError."""
        return Connection(
            host,
            self._team.robot(peer).port_for(self._me.name),
            send_before_ready=time.monotonic() >= self._wait_until_s.get(peer, 0.0),
            keys=self._keys.pair(peer),
        )

    def closed(self, peer: str, connection: Connection, now_s: float) -> None:
        """Note a closed connection: if it had to wait for the peer's READY, so do the next ones."""
        if not connection.send_before_ready and now_s >= self._wait_until_s.get(peer, 0.0):
            self._wait_until_s[peer] = now_s + WAIT_FOR_READY_S
