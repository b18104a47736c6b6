"""Nodes as processes, all in mutual range: what a contact costs, how soon messages arrive."""

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from benchmarks.fleet.processes import HERE, TIMES, Summary, fleet, missing, own_loopback
from benchmarks.goals.figure import Conditions, Figure

SIZES = (3, 10, 30)
OTHERS = {"zeromq": SIZES, "zenoh": (10, 30), "cyclonedds": (10, 30)}
QUICK = replace(TIMES, settle_s=4, idle_s=3, busy_s=3, tail_s=1)
PEERS, DESCRIPTORS = 219, 1024
# Under a limit of descriptors: how long a node, or as many bare ports, takes to be there.
START = """
import resource, socket, sys, time
from pathlib import Path
from mocha_link import Node, Team
resource.setrlimit(resource.RLIMIT_NOFILE, (int(sys.argv[2]), int(sys.argv[2])))
team = Team.load(Path(sys.argv[1]))
node = Node(team, "rover000")
began_s = time.perf_counter()
with node:
    print(time.perf_counter() - began_s)
began_s = time.perf_counter()
kinds = (socket.SOCK_STREAM, socket.SOCK_DGRAM)
ports = [socket.socket(type=kind) for _ in team.robots for kind in kinds]
for port in ports:
    port.bind(("127.0.0.1", 0))
print(time.perf_counter() - began_s)
"""


def measure(conditions: Conditions) -> Iterator[Figure]:
    """Fleets of ours, and of others beside them."""
    own_loopback()
    sizes = SIZES[:1] if conditions.quick else SIZES
    times = QUICK if conditions.quick else TIMES
    fleets: dict[int, dict[str, Summary]] = {}
    for size in sizes:
        fleets[size] = {"": fleet(size, times=times)}
        for way, measured in OTHERS.items():
            if (size in measured or conditions.quick) and not missing(way):
                fleets[size][way] = fleet(size, way, times=times)
        if conditions.against:
            name = conditions.against.name
            fleets[size][name] = fleet(size, checkout=conditions.against, times=times)
        yield from _of(fleets[size])
    if not conditions.quick:
        yield from _growth(fleets[SIZES[1]], fleets[SIZES[2]])
    yield _start()


def _of(found: dict[str, Summary]) -> Iterator[Figure]:
    count = found[""].nodes

    def figure(what: str, unit: str, goal: float | None, values: dict[str, float]) -> Figure:
        return Figure(
            f"{count} nodes: {what}",
            values[""],
            unit,
            goal,
            anchors={name: value for name, value in values.items() if name},
        )

    p50 = {name: one.delay_ms(0.5) for name, one in found.items()}
    p99 = {name: one.delay_ms(0.99) for name, one in found.items()}
    yield figure("published to all, p50", "ms", 20, p50)
    yield figure("published to all, p99", "ms", 50, p99)
    arrived = {name: 100 * len(one.delays_s) / one.wanted for name, one in found.items()}
    yield figure("of the messages arrived", "%", None, arrived)
    busy = {name: 100 * one.busy_core_share for name, one in found.items()}
    yield figure("a node at 100 messages/s", "% of a core", None, busy)
    idle = {name: 100 * one.idle_core_share for name, one in found.items()}
    yield figure("an idle node", "% of a core", 0.3, idle)
    carried = {name: one.idle_contact_bytes_s for name, one in found.items()}
    yield figure("an idle contact, with headers", "bytes/s", 100, carried)
    yield figure("memory of a node", "MB", 60, {n: one.memory_mb for n, one in found.items()})
    threads = {name: one.threads - 1.0 for name, one in found.items()}
    yield figure("threads beside the program's", "", None, threads)


def _growth(few: dict[str, Summary], many: dict[str, Summary]) -> Iterator[Figure]:
    """What one more peer in contact takes."""
    values = {
        name: (many[name].descriptors - few[name].descriptors)
        / (many[name].nodes - few[name].nodes)
        for name in many
        if name in few
    }
    ours = values.pop("")
    yield Figure("descriptors for each peer in contact", ours, "", 3, anchors=values)


def _start() -> Figure:
    """A node with more peers than it has descriptors for as it likes them."""
    names = [f"rover{number:03}" for number in range(PEERS + 1)]
    lines = [
        f"  {name}: {{kind: rover, address: 127.0.0.1, base_port: {20_000 + 300 * (n == 0) + n}, "
        f"clients: [{', '.join(names[1:]) if n == 0 else names[0]}]}}"
        for n, name in enumerate(names)
    ]
    text = "\n".join(
        ["robots:", *lines, "kinds: {rover: {topics: [{name: /pose, type: json/Pose}]}}"]
    )
    with tempfile.TemporaryDirectory() as folder:
        team_file = Path(folder, "team.yaml")
        team_file.write_text(text, encoding="utf-8")
        done = subprocess.run(  # noqa: S603 - ourselves
            [sys.executable, "-c", START, str(team_file), str(DESCRIPTORS)],
            capture_output=True,
            text=True,
            cwd=HERE,
            timeout=120,
            check=True,
        )
    ours_s, bare_s = map(float, done.stdout.split())
    what = f"start with {PEERS} peers, {DESCRIPTORS} descriptors"
    return Figure(
        what, ours_s * 1e3, "ms", anchors={"as many bare TCP and UDP ports": bare_s * 1e3}
    )
