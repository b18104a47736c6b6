"""One node of a fleet, in a process of its own: ours, or of a library that does the same.

Run by its path with a plan as JSON. Of this checkout it imports nothing, so that what is compared
may be the `mocha_link` of another one.
"""

import contextlib
import json
import os
import resource
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Protocol

TOPIC = "/pose"
NETWORK = "/proc/self/net/dev"  # what this network namespace has carried


@dataclass(frozen=True, slots=True)
class Plan:
    """What all nodes of a fleet do, and when.

    Attributes:
        way: which library they are made of.
        ports: the first port of each node, by its name.
        team_file: of ours only.
        settle_s: after the start, before anything is measured.
        idle_s: while nothing is published.
        busy_s: while all publish, one after the other.
        tail_s: for what is still under way.
        rate_hz: messages of all nodes together.
    """

    way: str
    ports: dict[str, int]
    team_file: str
    settle_s: float
    idle_s: float
    busy_s: float
    tail_s: float
    rate_hz: float

    @property
    def messages(self) -> int:
        """How many each node publishes."""
        return int(self.busy_s * self.rate_hz / len(self.ports))


@dataclass(frozen=True, slots=True)
class Share:
    """What one node saw and took."""

    idle_core_share: float
    idle_syncs: int
    idle_bytes_s: float  # of the whole fleet with all headers, as this node's clock has it
    busy_core_share: float
    descriptors: int
    threads: int
    memory_mb: float
    timeouts: int
    delays_s: list[float]


class Way(Protocol):
    """One node of a library, linked to all others; reports what it gets, from any thread."""

    def __init__(self, plan: Plan, name: str, got: Callable[[bytes], None]) -> None: ...

    def publish(self, data: bytes) -> None:
        """To all others."""

    def counts(self) -> tuple[int, int]:
        """Syncs that began and that timed out since the last call."""

    def close(self) -> None:
        """Stop."""


class MochaLink:
    """Ours: nodes of a team that pull by the timer, and push to who follows."""

    def __init__(self, plan: Plan, name: str, got: Callable[[bytes], None]) -> None:
        from mocha_link import MessageStored, Node, SyncStarted, SyncTimedOut, Team  # noqa: PLC0415

        self._counts = {SyncStarted: 0, SyncTimedOut: 0}

        def note(event: object) -> None:
            if isinstance(event, MessageStored) and event.robot != name:
                message = self._node.latest(event.robot, TOPIC)
                if message:
                    got(message.data)
            elif type(event) in self._counts:
                self._counts[type(event)] += 1

        self._node = Node(Team.load(Path(plan.team_file)), name)
        self._node.subscribe(note)
        self._node.start()

    def publish(self, data: bytes) -> None:
        self._node.publish(TOPIC, data)

    def counts(self) -> tuple[int, int]:
        begun, timed_out = self._counts.values()
        self._counts.update(dict.fromkeys(self._counts, 0))
        return begun, timed_out

    def close(self) -> None:
        self._node.close()


class _Other:
    """Of the others nothing but messages is known."""

    def counts(self) -> tuple[int, int]:
        return 0, 0

    def close(self) -> None:
        """The process ends."""


class ZeroMq(_Other):
    """Bare ZeroMQ: a PUB socket for all, and a thread with a SUB socket to each. Keeps nothing."""

    def __init__(self, plan: Plan, name: str, got: Callable[[bytes], None]) -> None:
        import zmq  # noqa: PLC0415 - only where it is measured

        context = zmq.Context()
        self._publisher = context.socket(zmq.PUB)
        self._publisher.bind(f"tcp://127.0.0.1:{plan.ports[name]}")
        subscriber = context.socket(zmq.SUB)
        subscriber.subscribe(b"")
        for other, port in plan.ports.items():
            if other != name:
                subscriber.connect(f"tcp://127.0.0.1:{port}")

        def receive() -> None:
            while True:
                got(subscriber.recv())

        threading.Thread(target=receive, daemon=True).start()

    def publish(self, data: bytes) -> None:
        self._publisher.send(data)


class Zenoh(_Other):
    """eclipse-zenoh: a session in the mode `peer`, linked by TCP to each; nothing is batched."""

    def __init__(self, plan: Plan, name: str, got: Callable[[bytes], None]) -> None:
        import zenoh  # noqa: PLC0415 - only where installed

        names = list(plan.ports)
        earlier = names[: names.index(name)]  # two sessions keep one connection between them
        config = zenoh.Config()
        for key, value in {
            "mode": "peer",
            "scouting/multicast/enabled": False,
            "scouting/gossip/enabled": False,
            "transport/shared_memory/enabled": False,
            "listen/endpoints": [f"tcp/127.0.0.1:{plan.ports[name]}"],
            "connect/endpoints": [f"tcp/127.0.0.1:{plan.ports[other]}" for other in earlier],
        }.items():
            config.insert_json5(key, json.dumps(value))
        self._session = zenoh.open(config)
        self._subscriber = self._session.declare_subscriber(
            "pose/*",
            lambda sample: got(sample.payload.to_bytes()),
            allowed_origin=zenoh.Locality.REMOTE,
        )
        self._publisher = self._session.declare_publisher(f"pose/{name}", express=True)

    def publish(self, data: bytes) -> None:
        self._publisher.put(data)


CYCLONE = """<CycloneDDS><Domain><General>
<Interfaces><NetworkInterface name="lo" multicast="false"/></Interfaces>
<AllowMulticast>false</AllowMulticast>
</General><Discovery><Peers><Peer Address="127.0.0.1"/></Peers>
<ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>110</MaxAutoParticipantIndex>
</Discovery></Domain></CycloneDDS>"""


class CycloneDds(_Other):
    """CycloneDDS: a reliable topic with a key for each node, by unicast on the loopback."""

    def __init__(self, plan: Plan, name: str, got: Callable[[bytes], None]) -> None:
        from cyclonedds import core, domain, pub, sub, topic  # noqa: PLC0415 - where installed
        from cyclonedds.idl import IdlStruct, annotations, types  # noqa: PLC0415
        from cyclonedds.util import duration  # noqa: PLC0415

        @dataclass
        class Pose(IdlStruct, typename="Pose"):
            name: str
            annotations.key("name")
            data: types.sequence[types.uint8]  # type: ignore[type-arg]

        policy = core.Policy
        reliable = policy.Reliability.Reliable(duration(seconds=1))
        qos = core.Qos(reliable, policy.History.KeepLast(1))
        self._domain = domain.Domain(0, CYCLONE)
        participant = domain.DomainParticipant(0)
        poses = topic.Topic(participant, "pose", Pose, qos=qos)
        reader = sub.DataReader(participant, poses, qos=qos)
        self._writer = pub.DataWriter(participant, poses, qos=qos)
        self._pose: Callable[[bytes], Any] = lambda data: Pose(name, list(data))

        def receive() -> None:  # a listener's lock and the interpreter's wait for each other
            with contextlib.suppress(core.DDSException):  # the process ends
                while True:
                    for pose in reader.take_iter(timeout=duration(seconds=1)):
                        if pose.name != name:
                            got(bytes(pose.data))

        threading.Thread(target=receive, daemon=True).start()

    def publish(self, data: bytes) -> None:
        self._writer.write(self._pose(data))


WAYS: dict[str, type[Way]] = {
    "mocha_link": MochaLink,
    "zeromq": ZeroMq,
    "zenoh": Zenoh,
    "cyclonedds": CycloneDds,
}


def live(plan: Plan, name: str) -> Share:
    """Be one node: idle, then publishing; all keep the same times, from a line on stdin."""
    delays_s: list[float] = []
    node = WAYS[plan.way](plan, name, lambda data: delays_s.append(time.time() - json.loads(data)))
    print("ready", flush=True)
    start_s = float(sys.stdin.readline())
    try:
        _until(start_s + plan.settle_s)
        node.counts()
        idle_from_s, carried_from = time.process_time(), carried_bytes()
        busy_at_s = start_s + plan.settle_s + plan.idle_s
        _until(busy_at_s)
        idle_s, carried = time.process_time() - idle_from_s, carried_bytes() - carried_from
        syncs, idle_timeouts = node.counts()
        busy_from_s = time.process_time()
        turn = list(plan.ports).index(name)
        for number in range(plan.messages):
            _until(busy_at_s + (number * len(plan.ports) + turn) / plan.rate_hz)
            node.publish(json.dumps(time.time()).encode())
        busy_s = time.process_time() - busy_from_s
        _until(busy_at_s + plan.busy_s + plan.tail_s)
        return Share(
            idle_core_share=idle_s / plan.idle_s,
            idle_syncs=syncs,
            idle_bytes_s=carried / plan.idle_s,
            busy_core_share=busy_s / plan.busy_s,
            descriptors=len(list(Path("/proc/self/fd").iterdir())),
            threads=len(list(Path("/proc/self/task").iterdir())),
            memory_mb=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
            timeouts=idle_timeouts + node.counts()[1],
            delays_s=delays_s,
        )
    finally:
        node.close()


def carried_bytes() -> int:
    """All that the loopback of this network namespace has carried."""
    lines = Path(NETWORK).read_text(encoding="ascii").splitlines()
    return next(int(each.split()[1]) for each in lines if each.strip().startswith("lo:"))


def _until(unix_s: float) -> None:
    time.sleep(max(unix_s - time.time(), 0.0))


if __name__ == "__main__":
    share = live(Plan(**json.loads(sys.argv[1])), sys.argv[2])
    print(json.dumps(asdict(share)), flush=True)
    os._exit(0)  # threads of libraries that wait for ever must not keep the process
