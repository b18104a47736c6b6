"""A fleet as processes on this machine: starts its nodes together, and sums up what they saw."""

import importlib.util
import json
import os
import socket
import statistics
import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from time import time

from benchmarks.fleet import node
from benchmarks.fleet.node import Plan, Share
from benchmarks.link.namespaces import EmulationError, enter, raise_loopback

HERE = Path(__file__).parents[2]
RATE_HZ = 100.0  # of all nodes together
NEEDS = {"zeromq": "zmq", "zenoh": "zenoh", "cyclonedds": "cyclonedds"}
# Ours settle when pulls have become one in 15 s, of which a whole period is looked at; the others
# once all have found all.
TIMES = Plan("mocha_link", {}, "", settle_s=20, idle_s=15, busy_s=10, tail_s=3, rate_hz=RATE_HZ)
OTHERS_SETTLE_S = 8.0


@dataclass(frozen=True, slots=True)
class Summary:
    """What a fleet of `nodes` took, per node (means; descriptors, threads and memory: the most).

    Attributes:
        idle_contact_bytes_s: what each pair exchanged while nothing was published, both ways, with
            all headers.
        delays_s: from publishing to every other program, in order.
        wanted: so many there would be if every message reached every other node.
    """

    nodes: int
    idle_core_share: float
    idle_syncs_s: float
    idle_contact_bytes_s: float
    busy_core_share: float
    descriptors: int
    threads: int
    memory_mb: float
    timeouts: int
    delays_s: list[float]
    wanted: int

    def delay_ms(self, part: float) -> float:
        """The delay below which that part of all stays; nan: nothing arrived."""
        if not self.delays_s:
            return float("nan")
        return self.delays_s[int(part * (len(self.delays_s) - 1))] * 1e3


def missing(way: str) -> str | None:
    """The package that a way lacks here, if any."""
    needs = NEEDS.get(way)
    return needs if needs and importlib.util.find_spec(needs) is None else None


def own_loopback() -> bool:
    """Move this process and its children to a loopback that nothing else uses, where we may."""
    try:
        enter()
    except EmulationError:
        return False
    raise_loopback()
    return True


def fleet(
    count: int, way: str = "mocha_link", checkout: Path = HERE, times: Plan = TIMES
) -> Summary:
    """Let so many nodes run, for as long as the times are, and a second for each four nodes."""
    names = [f"rover{number:02}" for number in range(count)]
    ports = dict(zip(names, free_ranges(count), strict=True))
    settle_s = times.settle_s if way == "mocha_link" else min(times.settle_s, OTHERS_SETTLE_S)
    with tempfile.TemporaryDirectory() as folder:
        team_file = Path(folder, "team.yaml")
        team_file.write_text(team_text(ports), encoding="utf-8")
        plan = replace(times, way=way, ports=ports, team_file=str(team_file), settle_s=settle_s)
        command = [sys.executable, node.__file__, json.dumps(asdict(plan))]
        processes = [
            subprocess.Popen(  # noqa: S603 - ourselves
                [*command, name],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                env=os.environ | {"PYTHONPATH": str(checkout)},
                cwd=checkout,
                text=True,
            )
            for name in names
        ]
        try:
            for each in processes:
                if each.stdout:
                    each.stdout.readline()
            start = f"{time() + 1.0}\n"
            for each in processes:
                if each.stdin:
                    each.stdin.write(start)
                    each.stdin.flush()
            shares = [Share(**json.loads(each.communicate()[0])) for each in processes]
        finally:
            for each in processes:
                each.kill()
    return summary(shares, plan)


def summary(shares: list[Share], plan: Plan) -> Summary:
    count = len(shares)

    def mean(values: list[float]) -> float:
        return statistics.fmean(values)

    return Summary(
        nodes=count,
        idle_core_share=mean([share.idle_core_share for share in shares]),
        idle_syncs_s=mean([share.idle_syncs for share in shares]) / plan.idle_s,
        idle_contact_bytes_s=mean([share.idle_bytes_s for share in shares])
        / (count * (count - 1) / 2),
        busy_core_share=mean([share.busy_core_share for share in shares]),
        descriptors=max(share.descriptors for share in shares),
        threads=max(share.threads for share in shares),
        memory_mb=max(share.memory_mb for share in shares),
        timeouts=sum(share.timeouts for share in shares),
        delays_s=sorted(delay_s for share in shares for delay_s in share.delays_s),
        wanted=plan.messages * count * (count - 1),
    )


def team_text(ports: dict[str, int]) -> str:
    """A team of robots on this machine, all linked to all."""
    lines = ["robots:"]
    for name, base in ports.items():
        others = ", ".join(other for other in ports if other != name)
        lines.append(
            f"  {name}: {{kind: rover, address: 127.0.0.1, base_port: {base}, clients: [{others}]}}"
        )
    lines.append(f"kinds: {{rover: {{topics: [{{name: {node.TOPIC}, type: json/Pose}}]}}}}")
    return "\n".join(lines) + "\n"


def free_ranges(count: int) -> list[int]:
    """The first of as many ports in a row that are free now, for each of so many nodes."""
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
