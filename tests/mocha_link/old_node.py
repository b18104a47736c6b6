"""An original node in the network of `NetworkSim`."""

from collections.abc import Sequence

from benchmarks.fleet.network_sim import NetworkSim
from mocha_link.clock import Instant
from mocha_link.sync.protocol import Action, Reply
from tests.mocha_link import original


class OldNode(original.Original):
    """Stands in for an original node that is pulled from, in the network instead of on sockets."""

    wake_s = None
    _links = ()

    def __init__(self, net: NetworkSim, name: str) -> None:
        super().__init__(net.team, name, now_s=lambda: net.at(name).unix_s)
        self.me = self.robot
        self._actions: list[Action] = []
        net.become(name, self)

    def request(
        self, peer: str, route: tuple[bytes, ...], parts: Sequence[bytes], _now: Instant
    ) -> None:
        answer = self.answer(peer, list(parts))
        if answer is not None:
            self._actions.append(Reply(peer, route, answer))

    def take(self) -> tuple[list[Action], list[object]]:
        actions, self._actions = self._actions, []
        return actions, []

    def supply(self, _peer: str) -> None:
        """Nothing is sent without a request."""

    def tick(self, _now: Instant) -> None:
        """Nothing happens by itself."""

    def packet_in(self, _peer: str, _packet: bytes, _now: Instant) -> bool:
        return False
