"""Our node on both sides, through its public interface: publish, a radio, its events."""

import threading

from benchmarks.link.offer import Offer, place
from benchmarks.link.team import SINK, SOURCE, robot_name, team_of, topic_name
from benchmarks.link.ways import ADDRESSES, ENDED, Deliver
from mocha_link import ManualRadio, MessageStored, Node, SyncEnded
from mocha_link.links import Direction, LinkEvent

RECEIVED_DBM = -50.0
START_S = 50.0


class _NodeSide:
    datagrams = True

    def __init__(self, offer: Offer, name: str, peer: str, addresses: tuple[str, str]) -> None:
        self._offer = offer
        self._peer = peer
        self._radio = ManualRadio()
        self._team = team_of(offer, addresses)
        self.node = Node(self._team, name, radio=self._radio, datagrams=self.datagrams)

    def start(self) -> None:
        self.node.start()

    def signal_received(self, *, again: bool) -> None:
        self._radio.report(self._peer, RECEIVED_DBM)

    def lost(self) -> None:
        self._radio.report(self._peer, None)

    def close(self) -> None:
        self.node.close()

    def data(self, key: int) -> bytes | None:
        robot, topic = place(key)
        message = self.node.latest(robot_name(robot), topic_name(topic))
        return message.data if message else None


class NodeSource(_NodeSide):
    """Holds the messages: its own, and those of others that it has pulled from them."""

    def __init__(self, offer: Offer, addresses: tuple[str, str] = ADDRESSES) -> None:
        super().__init__(offer, SOURCE, SINK, addresses)

    def start(self) -> None:
        super().start()
        by_robot: dict[int, list[int]] = {}
        for key in range(self._offer.count):
            by_robot.setdefault(place(key)[0], []).append(key)
        for robot, keys in by_robot.items():
            if robot:
                self._relay(robot_name(robot), keys)
            else:
                self._publish(self.node, keys)

    def _publish(self, node: Node, keys: list[int]) -> None:
        for key in keys:
            node.publish(topic_name(place(key)[1]), self._offer.data(key))

    def _relay(self, name: str, keys: list[int]) -> None:
        pulled = threading.Event()

        def notice(event: LinkEvent) -> None:
            if isinstance(event, SyncEnded) and event.direction is Direction.IN:
                pulled.set()

        with Node(self._team, name, radio=ManualRadio()) as other:
            self._publish(other, keys)
            end = self.node.subscribe(notice)
            self.node.sync(name)
            if not pulled.wait(START_S):
                raise TimeoutError(f"the messages of {name} could not be pulled on one machine")
            end()


class NodeSink(_NodeSide):
    """Wants the messages."""

    def __init__(
        self, offer: Offer, deliver: Deliver, addresses: tuple[str, str] = ADDRESSES
    ) -> None:
        super().__init__(offer, SINK, SOURCE, addresses)
        self._keys = {
            (robot_name(robot), topic_name(topic)): key
            for key in range(offer.count)
            for robot, topic in (place(key),)
        }
        self._deliver = deliver
        self.node.subscribe(self._notice)

    def _notice(self, event: LinkEvent) -> None:
        if isinstance(event, MessageStored):
            key = self._keys.get((event.robot, event.topic))
            if key is not None:
                self._deliver(key)
        elif isinstance(event, SyncEnded) and event.direction is Direction.IN:
            self._deliver(ENDED)


class TcpNodeSource(NodeSource):
    """The same without datagrams."""

    datagrams = False


class TcpNodeSink(NodeSink):
    """The same without datagrams."""

    datagrams = False
