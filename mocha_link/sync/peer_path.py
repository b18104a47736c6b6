"""The path to one peer: its connection for our pulls, measurements, and a limit on bytes."""

from __future__ import annotations

from mocha_link.sync.protocol import (
    DIALLED,
    NEAR_S,
    Connect,
    Disconnect,
    NodeContext,
    Reply,
    Route,
    Send,
)

MAX_MISSES = 2  # consecutive pulls on which datagrams delivered no messages
RETRY_EVERY = 8  # after that, datagrams are tried on every eighth pull only
LEAST_BUDGET = 1024  # no pull begins with less left


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


class PathMemory:
    """The round trip and rate of the path to one peer, and the failures on it.

    Attributes:
        rtt_s: the lowest round trip of the last pull; None: not known.
        rate_bytes_s: the rate of the last pull that was large enough; None: not known.
        udp_misses: consecutive pulls on which datagrams delivered no messages.
    """

    def __init__(self) -> None:
        self.rtt_s: float | None = None
        self.rate_bytes_s: float | None = None
        self.udp_misses = 0
        self._cut: dict[int, int] = {}  # by topic key: consecutive messages that were cut

    @property
    def is_near(self) -> bool:
        """Whether round trips are so short that connections are the better path."""
        return self.rtt_s is not None and self.rtt_s < NEAR_S

    def measured(self, rtt_s: float) -> None:
        """Note a measured round trip."""
        self.rtt_s = rtt_s

    def moved(self, rate_bytes_s: float | None) -> None:
        """Note the rate of a pull that has ended; None: it was too small to measure it."""
        self.rate_bytes_s = rate_bytes_s or self.rate_bytes_s

    def may_use_datagrams(self) -> bool:
        """Whether to try datagrams; call it once per pull."""
        if self.udp_misses < MAX_MISSES:
            return True
        self.udp_misses += 1
        return self.udp_misses % RETRY_EVERY == 0

    def datagrams_missed(self) -> None:
        """Note a pull on which the peer replied by datagrams but delivered no messages."""
        self.udp_misses += 1

    def datagrams_carried(self) -> None:
        """Note that datagrams delivered messages."""
        self.udp_misses = 0

    def message_cut(self, topic_key: int) -> None:
        """Note that the link broke in the middle of a message of a topic."""
        self._cut[topic_key] = self._cut.get(topic_key, 0) + 1

    def message_arrived(self, topic_key: int) -> None:
        """Note that a whole message of a topic was received."""
        self._cut.pop(topic_key, None)

    def cuts(self, topic_key: int) -> int:
        """The number of consecutive messages of a topic that were cut."""
        return self._cut.get(topic_key, 0)


class ContactBudget:
    """The budget of the contact with one peer.

    Args:
        limit_bytes: may be received during a contact; 0: no limit.
    """

    def __init__(self, limit_bytes: int) -> None:
        self._limit_bytes = limit_bytes
        self._spent_bytes = 0  # of this contact

    @property
    def pull_bytes(self) -> int:
        """Bytes that a pull which begins now may receive; 0: no limit.

        At least `LEAST_BUDGET`: a running pull may continue over another connection after the
        budget is spent.
        """
        return max(self._left_bytes, LEAST_BUDGET) if self._limit_bytes else 0

    @property
    def is_spent(self) -> bool:
        """Whether no further pull may begin in this contact."""
        return bool(self._limit_bytes) and self._left_bytes < LEAST_BUDGET

    @property
    def _left_bytes(self) -> int:
        return self._limit_bytes - self._spent_bytes

    def spend(self, size: int) -> None:
        """Count received bytes."""
        self._spent_bytes += size

    def renew(self) -> None:
        """Reset the budget: a contact begins."""
        self._spent_bytes = 0
