"""Many nodes that all hear each other, as processes: what contacts cost, how soon news arrives.

    python -m benchmarks.fleet 2 10 30
    python -m benchmarks.fleet --against ../before 30      # another checkout, in the same run

For each size and checkout: the processor, the descriptors and the memory that a node takes while
nothing is published; then the time from publishing to every other robot at 100 messages a second
over all, with the processor that this takes. Here nodes share cores that each robot has for itself.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

SETTLE_S, IDLE_S, BUSY_S = 15.0, 10.0, 10.0
RATE_HZ = 100.0  # of all nodes together
TAIL_S = 5.0
TOPIC = "/pose"


@dataclass(frozen=True, slots=True)
class Share:
    """What one node saw and took."""

    idle_core_share: float
    idle_syncs: int
    busy_core_share: float
    descriptors: int
    memory_mb: float
    timeouts: int
    delays_s: list[float]


def team_text(count: int) -> str:
    """A team of robots on this machine, each with ports that are free now, all linked to all."""
    names = [f"rover{number:02}" for number in range(count)]
    lines = ["robots:"]
    for name, base in zip(names, _free_ranges(count), strict=True):
        others = ", ".join(other for other in names if other != name)
        lines.append(
            f"  {name}: {{kind: rover, address: 127.0.0.1, base_port: {base}, clients: [{others}]}}"
        )
    lines.append(f"kinds: {{rover: {{topics: [{{name: {TOPIC}, type: json/Pose}}]}}}}")
    return "\n".join(lines) + "\n"


def _free_ranges(count: int) -> list[int]:
    found: list[int] = []
    base = 20_000
    while len(found) < count:
        if all(_is_free(base + offset) for offset in range(count)):
            found.append(base)
        base += count
    return found


def _is_free(port: int) -> bool:
    with socket.socket() as probe:
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return False
    return True


def node(team_file: str, name: str) -> Share:
    """One robot: idle, then publishing; all robots keep the same times, from a word on stdin."""
    # Only here: what is compared runs this file with its own package.
    from mocha_link import MessageStored, Node, SyncStarted, SyncTimedOut, Team  # noqa: PLC0415

    team = Team.load(Path(team_file))
    delays_s: list[float] = []
    counts = {SyncStarted: 0, SyncTimedOut: 0}

    def note(event: object) -> None:
        if isinstance(event, MessageStored) and event.robot != name:
            message = one.latest(event.robot, TOPIC)
            if message:
                delays_s.append(time.time() - json.loads(message.data))
        elif type(event) in counts:
            counts[type(event)] += 1

    one = Node(team, name)
    one.subscribe(note)
    one.start()
    print("ready", flush=True)
    start_s = float(sys.stdin.readline())
    try:
        _until(start_s + SETTLE_S)
        counts.update(dict.fromkeys(counts, 0))
        idle_from_s = time.process_time()
        _until(start_s + SETTLE_S + IDLE_S)
        idle_s, syncs = time.process_time() - idle_from_s, counts[SyncStarted]
        busy_from_s = time.process_time()
        step_s = len(team.robots) / RATE_HZ
        due_s = (
            start_s + SETTLE_S + IDLE_S + step_s * list(team.robots).index(name) / len(team.robots)
        )
        while due_s < start_s + SETTLE_S + IDLE_S + BUSY_S:
            _until(due_s)
            one.publish(TOPIC, json.dumps(time.time()).encode())
            due_s += step_s
        busy_s = time.process_time() - busy_from_s
        _until(start_s + SETTLE_S + IDLE_S + BUSY_S + TAIL_S)
        return Share(
            idle_s / IDLE_S,
            syncs,
            busy_s / BUSY_S,
            len(list(Path("/proc/self/fd").iterdir())),
            resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
            counts[SyncTimedOut],
            delays_s,
        )
    finally:
        one.close()


def _until(unix_s: float) -> None:
    time.sleep(max(unix_s - time.time(), 0.0))


def fleet(count: int, checkout: Path) -> list[Share]:
    """What each of so many nodes saw, with the packages of a checkout."""
    with tempfile.TemporaryDirectory() as folder:
        team_file = Path(folder, "team.yaml")
        team_file.write_text(team_text(count))
        command = [sys.executable, str(Path(__file__).resolve()), "--node", str(team_file)]
        environment = os.environ | {"PYTHONPATH": str(checkout)}
        nodes = [
            subprocess.Popen(  # noqa: S603 - ourselves
                [*command, f"rover{number:02}"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                env=environment,
                cwd=checkout,
                text=True,
            )
            for number in range(count)
        ]
        for each in nodes:
            if each.stdout:
                each.stdout.readline()
        start = f"{time.time() + 1.0}\n"
        for each in nodes:
            if each.stdin:
                each.stdin.write(start)
                each.stdin.flush()
        return [Share(**json.loads(each.communicate()[0])) for each in nodes]


def summary(shares: list[Share]) -> str:
    """One line of the table."""
    delays_s = sorted(delay_s for share in shares for delay_s in share.delays_s)

    def mean(values: list[float]) -> float:
        return statistics.fmean(values)

    def at(part: float) -> str:
        return f"{delays_s[int(part * (len(delays_s) - 1))] * 1000:.1f}" if delays_s else "-"

    return (
        f"{100 * mean([s.idle_core_share for s in shares]):8.2f} "
        f"{mean([s.idle_syncs for s in shares]) / IDLE_S:8.1f} "
        f"{100 * mean([s.busy_core_share for s in shares]):8.2f} "
        f"{at(0.5):>8} {at(0.99):>8} {len(delays_s):8} "
        f"{sum(s.timeouts for s in shares):8} {max(s.descriptors for s in shares):6} "
        f"{max(s.memory_mb for s in shares):6.0f}"
    )


def main() -> None:
    """Print the table; each line is on its way for half a minute and more."""
    if sys.argv[1:2] == ["--node"]:
        print(json.dumps(asdict(node(sys.argv[2], sys.argv[3]))))
        return
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("sizes", type=int, nargs="*", default=[2, 10, 30], help="nodes, 2 to 100")
    parser.add_argument("--against", type=Path, help="another checkout, measured beside this one")
    options = parser.parse_args()
    here = Path(__file__).resolve().parent.parent
    checkouts = {"here": here}
    if options.against:
        checkouts[options.against.name] = options.against.resolve()
    print(
        f"{'nodes':>5} {'':12} {'idle %':>8} {'syncs/s':>8} {'busy %':>8} "
        f"{'p50 ms':>8} {'p99 ms':>8} {'got':>8} {'timeouts':>8} {'fds':>6} {'MB':>6}"
    )
    for size in options.sizes:
        for name, checkout in checkouts.items():
            print(f"{size:5} {name:12} {summary(fleet(size, checkout))}", flush=True)


if __name__ == "__main__":
    main()
