"""Records the golden streams from the program as it runs.

python -m tests.golden.record [NAME ...]               fly and run anew what is listed below
python -m tests.golden.record --decisions [NAME ...]   keep the events, decide on them anew

All of them, or those of which NAME is a part. The second is for a change that is meant to decide
otherwise: `git diff` shows which streams it concerns, the failed test what it changes in them, and
the commit says why.

These twenty cover most: chosen one after the other by how many pairs of state and event with a
decision, a signal or a policy no stream before them has; together they have 614 of the 646 that 61
streams had.

Numbers are rounded when they are written. What is kept are the decisions on the rounded events;
where the flight itself decided otherwise, that is printed.
"""

import argparse
import itertools
import random
import tempfile
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import yaml

from benchmarks.fleet.network_sim import STEADY_S, NetworkSim, T
from mocha_link.team.document import Document
from mocha_link.team.team import Team
from tests.golden import nodes
from tests.golden.adapter import fly, make_run
from tests.golden.plain import Tape
from tests.golden.streams import FOLDER, SUFFIX, Step, Stream, decided, read, write

MISSIONS = Path(__file__).parents[2] / "missions"

FLIGHTS = (
    ("pennovation", "PILOT", 3),
    ("pennovation", "HAND_BACK", 3),
    ("pennovation", "REQUESTS", 1),
    ("pennovation", "REQUESTS", 5),
    ("pennovation", "WALL", 14),
    ("pennovation", "BATTERY", 24),
    ("pennovation", "RESTART", 3),
    ("pennovation", "PLAN_REPLACED", 2),
    ("pennovation", "HOME_MOVED", 1),
    ("urban", "REQUESTS", 2),
    ("urban", "RELOAD", 3),
    ("urban", "TWO_STATIONS", 2),
    ("large", "REQUESTS", 0),
    ("pair", "REQUESTS", 6),
)
"""Mission, what goes wrong, and seed."""

_SHORT = {
    "duration_s": 240,
    "timers": {"init_s": 50, "explore_s": 25, "search_s": 5, "communicate_s": 20},
}
RUNS: Mapping[str, dict[str, Any]] = {"two-uavs": {"uavs": 2, "protocol": "ours"}}
"""Runs of experiments in the town of missions/urban: what is not as usual."""

SYNCS: Mapping[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "connections": ({"delay_s": 0.02}, {}),
    "datagrams": ({"datagrams": True, "delay_s": 0.01}, {}),
    "by-timer": ({"datagrams": True, "by_timer": True}, {}),
    "original": ({"delay_s": 0.02}, {"titan": {"original": True}, "io": {"original": True}}),
}
"""Nodes that meet: what is between them, and what of the team is not as usual."""

ONLY: Mapping[str, int] = {
    "pennovation-restart-3": 2,
    "sync-connections": 4,
    "sync-datagrams": 4,
    "sync-by-timer": 4,
    "sync-original": 2,
}
"""Which companion or node is kept of several; the others tell no more."""


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m tests.golden.record",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--decisions", action="store_true", help="keep the events that are there")
    parser.add_argument("names", nargs="*", metavar="NAME", help="only these, by a part of them")
    arguments = parser.parse_args()
    FOLDER.mkdir(exist_ok=True)
    work = decide_anew if arguments.decisions else record
    work(lambda name: not arguments.names or any(part in name for part in arguments.names))


def decide_anew(meant: Callable[[str], bool]) -> None:
    """Keep the events, write down what is decided now."""
    for path in sorted(FOLDER.glob(f"*{SUFFIX}")):
        if meant(path.name):
            keep(path.name.removesuffix(SUFFIX), read(path))


def record(meant: Callable[[str], bool]) -> None:
    """Fly, sync and run anew."""
    for mission, fault, seed in FLIGHTS:
        name = f"{mission}-{fault.lower().replace('_', '-')}-{seed}"
        if meant(name):
            keep_tapes(name, flown(mission, fault, seed))
    for name, (options, changes) in SYNCS.items():
        if meant(f"sync-{name}"):
            keep_tapes(f"sync-{name}", synced(options, changes))
    for name, settings in RUNS.items():
        if meant(f"run-{name}"):
            keep_tapes(f"run-{name}", ran({**_SHORT, **settings}))


def flown(mission: str, fault: str, seed: int) -> list[Tape]:
    """Fly a mission of missions/, as it is or made into one that can be rehearsed."""
    path = MISSIONS / mission / "mission.yaml"
    with tempfile.TemporaryDirectory() as folder:
        if mission == "large":  # it names no team
            team = {"team": str(MISSIONS / "urban" / "team.yaml")}
            path = _changed(path, team, Path(folder))
        return fly(path, fault, seed)


def _changed(path: Path, changes: Mapping[str, Any], folder: Path) -> Path:
    mission = yaml.safe_load(path.read_text("utf-8"))
    files = {key: str(path.parent / mission[key]) for key in ("team", "world") if key in mission}
    changed = folder / "mission.yaml"
    text = yaml.safe_dump({**mission, **files, **changes}, sort_keys=False)
    changed.write_text(text, "utf-8")
    return changed


def ran(settings: Mapping[str, Any]) -> list[Tape]:
    """Make a run in the town of missions/urban."""
    names = ("town.yaml", "mission.yaml", "team.yaml", "world.yaml")
    files = {name: (MISSIONS / "urban" / name).read_text("utf-8") for name in names}
    own = {"town": "./town.yaml", "mission": "./mission.yaml"}
    return make_run({**own, **settings}, files, seed=7)


def synced(options: Mapping[str, Any], changes: Mapping[str, Any]) -> list[Tape]:
    """Let nodes meet: what is carried on, cut off, sent twice, lost and begun anew."""
    text = (Path(__file__).parents[1] / "data" / "mocha" / "team.yaml").read_text("utf-8")
    document = yaml.safe_load(text)
    for name, change in changes.items():
        document["robots"][name] |= change
    text = yaml.safe_dump(document)
    team = Team.from_document(Document.from_text(text, Path("team.yaml")))
    dice = random.Random(7)
    with nodes.tapped(text, T - STEADY_S) as tapes:
        net = NetworkSim(team, names=tuple(team.robots), **options)
        names = tuple(net.nodes)
        for turn in range(3):
            for name in names:
                for topic in team.topics_of(name):
                    net.publish(name, topic.name, dice.randbytes(200) * dice.choice((1, 30)))
            net.wait(1.5)
            net.left = 5 if turn == 1 else None  # the contact breaks off
            if turn == 2 and "datagrams" in options:
                net.blocked = {("zmq", *pair) for pair in itertools.permutations(names, 2)}
            for one, other in itertools.permutations(names, 2):
                net.nodes[one].signal_received(other, -60.0, net.at(one))
            net.wait(4.0)
            net.left = None
            if turn == 1:
                net.alter = lambda piece: piece.data[:-1] + bytes((piece.data[-1] ^ 1,))
                net.wait(2.0)
                net.alter = lambda piece: piece.data
                net.restart(names[0])
            for one, other in itertools.permutations(names, 2):
                net.nodes[one].signal_received(other, -95.0, net.at(one))
            net.wait(6.0)
    return tapes


def keep_tapes(name: str, tapes: Iterable[Tape]) -> None:
    """Write what was recorded: of a UAV's second companion, or a run's second UAV, beside it."""
    for number, tape in enumerate(tapes, 1):
        if ONLY.get(name, number) != number:
            continue
        stream = Stream(tape.setup, [Step(*step) for step in tape.steps])
        keep(name if number == 1 else f"{name}-{number}", stream)


def keep(name: str, stream: Stream) -> None:
    """Write a stream with what is decided now, and say so."""
    now = list(decided(stream))
    others = [s for s, one in zip(stream.steps, now, strict=True) if s.decided != one]
    steps = [s._replace(decided=one) for s, one in zip(stream.steps, now, strict=True)]
    path = FOLDER / f"{name}{SUFFIX}"
    write(path, stream._replace(steps=steps))
    size_kb, count = path.stat().st_size / 1e3, sum(map(len, now))
    line = f"{name:<32}{len(steps):>6} events {count:>5} decisions {size_kb:>5.0f} kB"
    print(  # noqa: T201 - what a program does
        line + (f", {len(others)} otherwise" if others else ""), flush=True
    )


if __name__ == "__main__":
    main()
