"""The connection over which we pull from a peer: ours, or one that the peer opened."""

from __future__ import annotations

from mocha_link.sync.protocol import DIALLED, Connect, Disconnect, NodeContext, Reply, Route, Send


class PullConnection:
    """Dials, uses and closes the connection for our pulls from one peer.

    Attributes:
        route: the peer's connection over which we pull; `DIALLED`: the one that we opened.
        stands: the one that we opened is established, as far as is known.
        shared: the peer pulls over the one that we opened.
    """

    def __init__(self, peer: str, node: NodeContext) -> None:
        self.route: Route = DIALLED
        self.stands = False
        self.shared = False
        self._peer = peer  # its name
        self._node = node

    @property
    def is_ours(self) -> bool:
        """Whether we pull over the connection that we opened."""
        return self.route == DIALLED

    def use(self, route: Route) -> None:
        """Pull over a connection from now on."""
        self.route = route

    def dial(self) -> None:
        """Request a new connection in place of the current one."""
        self.stands = self.shared = False
        self._node.actions.append(Connect(self._peer))

    def disconnect(self, *, void: bool) -> None:
        """Request that the connection that we opened is closed, unless the peer pulls over it."""
        if self.is_ours and not self.shared:
            self.stands = False
            self._node.actions.append(Disconnect(self._peer, void))

    def send(self, frame: bytes) -> None:
        """Send a request over the connection."""
        if self.is_ours:
            self._node.actions.append(Send(self._peer, frame))
        else:
            self._node.actions.append(Reply(self._peer, self.route, frame))

    def opened(self) -> None:
        """Note that the connection that we opened is established."""
        self.stands = True

    def lost(self, route: Route) -> None:
        """Note that a connection was lost."""
        self.stands = self.stands and route != DIALLED

    def share(self, route: Route | None) -> None:
        """Note the connection over which the peer pulls; None: it pulls over none."""
        self.shared = route == DIALLED

    def unshare(self) -> None:
        """Note that the peer does not pull over the connection that we opened."""
        self.shared = False
