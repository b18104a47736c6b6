"""Records the golden streams from the program as it runs.

python -m tests.golden.record [NAME ...]               fly and run anew what is listed below
python -m tests.golden.record --decisions [NAME ...]   keep the events, decide on them anew

All of them, or those of which NAME is a part. The second is for a change that is meant to decide
otherwise: `git diff` shows which streams it concerns, the failed test what it changes in them, and
the commit says why.

Numbers are rounded when they are written. What is kept are the decisions on the rounded events;
where the flight itself decided otherwise, that is said.
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
    ("pennovation", "NONE", 0),
    ("pennovation", "PILOT", 3),
    ("pennovation", "HAND_BACK", 3),
    ("pennovation", "STICKS", 4),
    ("pennovation", "REQUESTS", 1),
    ("pennovation", "REQUESTS", 5),
    ("pennovation", "RELOAD", 1),
    ("pennovation", "WALL", 14),
    ("pennovation", "NO_FIX", 1),
    ("pennovation", "BATTERY", 24),
    ("pennovation", "LOSS_20", 2),
    ("pennovation", "RESTART", 3),
    ("pennovation", "PLAN_REPLACED", 2),
    ("pennovation", "HOME_MOVED", 1),
    ("pennovation", "SILENCE", 6),
    ("urban", "REQUESTS", 2),
    ("urban", "RELOAD", 3),
    ("urban", "TWO_STATIONS", 2),
    ("large", "REQUESTS", 0),
    ("pair", "ONE_DEAD", 1),
    ("pair", "REQUESTS", 6),
    ("atlas", "ONE_DEAD", 0),
)
"""Mission, what goes wrong, and seed. In `pair` titan is flown and in `atlas` the other UAV, which
only searches."""

_SHORT = {
    "duration_s": 240,
    "timers": {"init_s": 50, "explore_s": 25, "search_s": 5, "communicate_s": 20},
}
RUNS: Mapping[str, dict[str, Any]] = {
    "original": {},
    "ours": {"protocol": "ours"},
    "two-uavs": {"uavs": 2, "protocol": "ours"},
    "two-uavs-original": {"uavs": 2, "ugvs": 5, "radius_m": 20},
    "freshest": {"policy": "freshest", "ugvs": 5},
    "rendezvous": {"policy": "rendezvous", "ugvs": 5},
    "rendezvous-ours": {"policy": "rendezvous", "protocol": "ours", "uavs": 2},
    "near": {"radius_m": 10, "goals": "seed", "starts": "seed"},
    "many": {"ugvs": 10, "protocol": "ours", "starts": "seed"},
    "path-loss": {"channel": "path_loss", "protocol": "ours", "uav_altitude_m": 70},
    "path-loss-original": {"channel": "path_loss", "uavs": 2, "uav_altitude_m": 70},
    "passive": {"passive": True, "protocol": "ours"},
    "no-base": {"base_station": False, "paper": {"cut": "drop", "order": "random"}},
    "high": {"uav_altitude_m": 80, "uav_speed_m_s": 6.5, "protocol": "ours"},
}
"""Runs of experiments in the town of missions/urban: what is not as usual."""

SYNCS: Mapping[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "connections": ({"delay_s": 0.02}, {}),
    "datagrams": ({"datagrams": True, "delay_s": 0.01}, {}),
    "by-timer": ({"datagrams": True, "by_timer": True}, {}),
    "original": ({"delay_s": 0.02}, {"titan": {"original": True}, "io": {"original": True}}),
}
"""Nodes that meet: what is between them, and what of the team is not as usual."""


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
        if mission == "atlas":  # the first UAV of a mission is flown
            path = MISSIONS / "pair" / "mission.yaml"
            uavs = yaml.safe_load(path.read_text("utf-8"))["uavs"]
            path = _changed(path, {"uavs": dict(reversed(uavs.items()))}, Path(folder))
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
                net.nodes[one].heard(other, -60.0, net.at(one))
            net.wait(4.0)
            net.left = None
            if turn == 1:
                net.alter = lambda piece: piece.data[:-1] + bytes((piece.data[-1] ^ 1,))
                net.wait(2.0)
                net.alter = lambda piece: piece.data
                net.restart(names[0])
            for one, other in itertools.permutations(names, 2):
                net.nodes[one].heard(other, -95.0, net.at(one))
            net.wait(6.0)
    return tapes


def keep_tapes(name: str, tapes: Iterable[Tape]) -> None:
    """Write what was recorded: of a UAV's second companion, or a run's second UAV, beside it."""
    for number, tape in enumerate(tapes, 1):
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
    said = f"{name:<32}{len(steps):>6} events {count:>5} decisions {size_kb:>5.0f} kB"
    print(  # noqa: T201 - what a program does
        said + (f", {len(others)} otherwise" if others else ""), flush=True
    )


if __name__ == "__main__":
    main()
