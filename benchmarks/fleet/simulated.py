"""Fleets in simulated time: what nodes send and take, without sockets and without other programs.

    python -m benchmarks.fleet.simulated 10 30 100

Whole nodes over the network of the tests, 10 ms from each to each. First one neighbourhood: all in
reach of all, idle once pulls are rare, then a message of each node. Then clusters of nine that only
mules join, which stay 10 s and move on; what has come with a mule is timed from when it arrives.
Times are simulated, but the processor's.
"""

import argparse
import contextlib
import heapq
import itertools
import math
import random
import statistics
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

from benchmarks.fleet.network_sim import NEAR_DBM, STEADY_S, Line, NetworkSim, team_of
from benchmarks.fleet.node import TOPIC
from benchmarks.fleet.processes import team_text
from mocha_link.links import Direction, MessageStored, SyncEnded

DELAY_S = 0.01  # half a round trip
SETTLE_S, IDLE_S, SPREAD_S = 35.0, 15.0, 3.0
STAY_S, RADIO_S = 10.0, 1.0
CLUSTER = 9
MESSAGE_BYTES = 2000


@dataclass(frozen=True, slots=True)
class Outcome:
    """What was seen of one fleet.

    Attributes:
        spread_s: from when a node could first have a message until it had, for each, in order.
        per_link: how often a message crossed the same link at most, in either direction.
        copies: how often it crossed any link for each node that got it; more than 1 where nodes met
            several at once that had it.
        empty_sync_ms: processor time of both sides, all else that nodes do while idle included.
        message_ms: processor time of sender and receiver for each message that a node got.
    """

    nodes: int
    spread_s: list[float]
    per_link: int
    copies: float
    empty_sync_ms: float = math.nan
    message_ms: float = math.nan


class FleetSim(NetworkSim):
    """The network of the tests for many nodes: only those to which something happens are driven.

    Attributes:
        processor_s: what the nodes took.
    """

    def __init__(self, names: list[str], *, by_timer: bool) -> None:
        self.processor_s = 0.0
        self._touched: dict[str, None] = {}
        self._wakes: list[tuple[float, str]] = []
        ports = {name: 20_000 + len(names) * number for number, name in enumerate(names)}
        team = team_of(team_text(ports))
        super().__init__(team, names=names, delay_s=DELAY_S, by_timer=by_timer)
        self._touched.update(dict.fromkeys(names))

    @contextlib.contextmanager
    def touch(self, name: str) -> Iterator[None]:
        """Something happens to a node, and it is driven next."""
        self._touched[name] = None
        began_s = time.process_time()
        try:
            yield
        finally:
            self.processor_s += time.process_time() - began_s

    def at_time(self, at_s: float, call: Callable[[], object]) -> None:
        """Have something happen later, in simulated seconds."""
        self.later(call, at_s)

    def signal_received(self, name: str, peer: str, reading: float | None) -> None:
        """A radio reports a reading of a peer."""
        with self.touch(name):
            self.nodes[name].signal_received(peer, reading, self.at(name))

    def publish_data(self, name: str, data: bytes) -> None:
        """A node publishes."""
        with self.touch(name):
            self.publish(name, TOPIC, data)

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        until_s = self.time_s + seconds
        self._act()
        while self.time_s < until_s:
            times = [queue[0][0] for queue in (self._due, self._wakes) if queue]
            self.time_s = max(self.time_s, min([*times, until_s]))
            while self._wakes and self._wakes[0][0] <= self.time_s:
                self._touched[heapq.heappop(self._wakes)[1]] = None
            if self._due and self._due[0][0] <= self.time_s:
                heapq.heappop(self._due)[2]()
            self._act()

    def _act(self) -> None:
        while self._touched:
            name = next(iter(self._touched))
            del self._touched[name]
            self._drive(name)

    def _drive(self, name: str) -> None:
        node, now = self.nodes[name], self.at(name)
        began_s = time.process_time()
        busy = node.tick(now)
        supplied = [
            (peer, *found) for peer in busy for found in iter(partial(node.supply, peer), None)
        ]
        actions, events = node.take()
        wake_s = min(node.wake_s or math.inf, now.steady_s + node.due_in_s(now)) - STEADY_S
        self.processor_s += time.process_time() - began_s
        self.events[name] += events
        for action in actions:
            self._do(name, action)
        for peer, route, parts in supplied:
            self._reply_on(name, peer, route, b"".join(parts))
        if wake_s < math.inf:
            heapq.heappush(self._wakes, (max(wake_s, self.time_s + 1e-4), name))

    def _stand(self, line: Line) -> None:
        with self.touch(line.client):
            super()._stand(line)

    def _request(self, line: Line, frame: bytes) -> None:
        with self.touch(line.server):
            super()._request(line, frame)

    def _reply(self, line: Line, frame: bytes) -> None:
        with self.touch(line.client):
            super()._reply(line, frame)


def message(number: int) -> bytes:
    """Noise that can be found again in what the network carries."""
    return random.Random(number).randbytes(MESSAGE_BYTES)


def crossings(net: FleetSim, data: bytes) -> Counter[frozenset[str]]:
    """How often a message was given to each link."""
    return Counter(
        frozenset((piece.source, piece.target))
        for piece in net.carried
        if len(piece.data) > MESSAGE_BYTES and data in piece.data
    )


def stored(net: FleetSim, since_s: float) -> dict[str, list[float]]:
    """When each node got which robot's message after a time, by its publisher."""
    found: dict[str, list[float]] = {}
    start_s = net.now.unix_s - net.time_s
    for name, events in net.events.items():
        for event in events:
            if isinstance(event, MessageStored) and event.robot != name:
                at_s = event.at_s - start_s
                if at_s >= since_s:
                    found.setdefault(event.robot, []).append(at_s)
    return found


def neighbourhood(count: int) -> Outcome:
    """All in reach of all; every node publishes once, all within a second."""
    names = [f"rover{number:03}" for number in range(count)]
    net = FleetSim(names, by_timer=True)
    net.wait(SETTLE_S)
    for events in net.events.values():
        events.clear()
    before_s = net.processor_s
    net.wait(IDLE_S)
    ends = [end for events in net.events.values() for end in events if isinstance(end, SyncEnded)]
    syncs = sum(end.direction is Direction.IN for end in ends)
    empty_sync_ms = (net.processor_s - before_s) / syncs * 1e3
    net.carried.clear()
    began_s, before_s = net.time_s, net.processor_s
    published_s = {name: began_s + number / count for number, name in enumerate(names)}
    for number, (name, at_s) in enumerate(published_s.items()):
        net.at_time(at_s, partial(net.publish_data, name, message(number)))
    net.wait(1.0 + SPREAD_S)
    got = stored(net, began_s)
    spread_s = sorted(at_s - published_s[name] for name, times_s in got.items() for at_s in times_s)
    arrived = len(spread_s)
    spread_s += [math.inf] * (count * (count - 1) - arrived)
    crossed = [crossings(net, message(number)) for number in range(0, count, 10)]
    return Outcome(
        count,
        spread_s,
        max(max(links.values()) for links in crossed),
        sum(links.total() for links in crossed) / (len(crossed) * (count - 1)),
        empty_sync_ms,
        (net.processor_s - before_s) / arrived * 1e3,
    )


def clusters(count: int) -> Outcome:
    """Clusters of at most nine, and a mule for each: one message, until all nodes have it."""
    names = [f"rover{number:03}" for number in range(count)]
    mules, others = names[: count // (CLUSTER + 1)], names[count // (CLUSTER + 1) :]
    places = max(3, len(mules))
    members = [others[place::places] for place in range(places)]
    net, data, source = FleetSim(names, by_timer=False), message(0), members[0][0]
    holders, spread_s = {source}, []
    reached_s: dict[int, float] = {}  # when the message came to a cluster, with a mule or at all
    for step in range(places + 1):
        met = [
            (place, mule)
            for number, mule in enumerate(mules)
            for place in [(number + step) % places]
        ]
        if not step:
            net.at_time(STAY_S / 2, partial(net.publish_data, source, data))
            reached_s[0] = STAY_S / 2
        began_s = net.time_s
        for place, mule in met:
            if mule in holders:
                reached_s.setdefault(place, began_s)
        _stay(net, members, [(mule, one) for place, mule in met for one in members[place]])
        place_of = {mule: place for place, mule in met}
        place_of |= {one: place for place, group in enumerate(members) for one in group}
        for at_s, name in _arrivals(net, source, holders):
            reached = reached_s[place_of[name]]
            spread_s.append(at_s - (max(reached, began_s) if name in mules else reached))
            holders.add(name)
    spread_s = sorted(spread_s) + [math.inf] * (count - len(holders))
    crossed = crossings(net, data)
    copies = crossed.total() / (len(holders) - 1)
    return Outcome(count, spread_s, max(crossed.values()), copies)


def _stay(net: FleetSim, members: list[list[str]], visits: list[tuple[str, str]]) -> None:
    """For a while all of a cluster receive each other and its mule, which is then out of reach."""
    visiting = [pair for visit in visits for pair in (visit, visit[::-1])]
    staying = [pair for group in members for pair in itertools.permutations(group, 2)]
    for second in range(int(STAY_S / RADIO_S)):
        for pair in staying + visiting:
            at_s = net.time_s + second * RADIO_S
            net.at_time(at_s, partial(net.signal_received, *pair, NEAR_DBM))
    net.wait(STAY_S)
    for pair in visiting:
        net.signal_received(*pair, None)


def _arrivals(net: FleetSim, source: str, holders: set[str]) -> list[tuple[float, str]]:
    """When further nodes got the source's message, in order."""
    start_s = net.now.unix_s - net.time_s
    return sorted(
        (event.at_s - start_s, name)
        for name, events in net.events.items()
        if name not in holders
        for event in events
        if isinstance(event, MessageStored) and event.robot == source
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("sizes", type=int, nargs="*", default=[10, 30, 100], help="nodes")
    sizes = parser.parse_args().sizes
    print(
        f"{'nodes':>5} {'':14} {'median ms':>10} {'last ms':>9} {'per link':>9} {'copies':>7} "
        f"{'empty sync':>11} {'message':>9}"
    )
    for count in sizes:
        for kind in (neighbourhood, clusters):
            one = kind(count)
            median_ms, last_ms = (
                value * 1e3 for value in (statistics.median(one.spread_s), one.spread_s[-1])
            )
            print(
                f"{count:5} {kind.__name__:14} {median_ms:10.1f} {last_ms:9.1f} "
                f"{one.per_link:9} {one.copies:7.2f} {one.empty_sync_ms:8.2f} ms "
                f"{one.message_ms:6.2f} ms",
                flush=True,
            )


if __name__ == "__main__":
    main()
