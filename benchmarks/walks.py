"""`python -m benchmarks.walks [--json]`: how many functions and files a decision passes through.

Eight walks of the running program, from what happens to what is done about it. Of each: calls of
our own functions as `sys.setprofile` counts them (comprehensions too, a generator each time it goes
on), files entered, and how often a call is in another file than the call before it. `geo` counts as
one file. Printed beside the budget and the figures of 2026-11-22 (there `geo` counted as several
files); the exit code is 1 when a walk is over its budget.

Events are those of the golden streams (tests/golden), whose adapter knows the names of today; those
of the live page stand under "Names of today" here. Where a way is taken again and again, the
shortest counts, in cruise the usual one: what is more of it is geometry.
"""

import argparse
import json
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from types import CodeType, FrameType
from typing import Any, Final, NamedTuple

from air_router.live import LivePage
from sitl.rehearsal import Fault, Scene, SceneOverError, SimulatedFlight
from tests.golden.adapter import construction_of, controller_of
from tests.golden.nodes import Node
from tests.golden.streams import FOLDER, SUFFIX, Step, Stream, read

ROOT = Path(__file__).parents[1]
PACKAGES = ("air_router", "mocha_link", "geo")
FLIGHT, RUN, SESSION = "urban-reload-3", "run-path-loss-original", "sync-connections-2"
ASK_S: Final = 70.0
"""When the page asks, simulated seconds: in cruise, with a clear way to the place."""


class Counts(NamedTuple):
    """How long a way is."""

    calls: int
    files: int
    changes: int


class Walk(NamedTuple):
    """A walk that is measured: what it is called, may take, and took on 2026-11-22."""

    name: str
    budget: Counts
    before: Counts


CRUISE = Walk("telemetry in cruise, nothing to do", Counts(15, 5, 8), Counts(45, 19, 29))
FOUND = Walk("robot's pose heard -> COMM", Counts(60, 9, 20), Counts(222, 26, 92))
SYNCED = Walk("second sync ended -> EXPL -> motion", Counts(80, 10, 25), Counts(307, 24, 107))
BEGUN = Walk("first telemetry in the air -> motion", Counts(80, 10, 25), Counts(268, 28, 85))
HOLD = Walk('page "hold" -> answer', Counts(25, 8, 14), Counts(46, 18, 33))
GOTO = Walk('page "goto" -> answer', Counts(150, 12, 45), Counts(875, 34, 298))
MADE = Walk("controller put together", Counts(60, 10, 20), Counts(358, 31, 112))
FRAME = Walk("frame of a peer -> database -> event", Counts(30, 7, 12), Counts(44, 11, 20))
WALKS = (CRUISE, FOUND, SYNCED, BEGUN, HOLD, GOTO, MADE, FRAME)


# Names of today.


class AskingScenario(SimulatedFlight):
    """A rehearsed flight with a live page, which asks in cruise for two things."""

    def __init__(self, asked: dict[Walk, Counts]) -> None:
        scene, mission = Scene(Fault.NONE, 0), ROOT / "missions" / "pennovation" / "mission.yaml"
        super().__init__(scene, mission)
        self._asked = asked
        self._page: LivePage | None = None

    def _tick(self) -> None:
        super()._tick()
        if self.companion is None:
            return
        flight = self.companion.flight
        if self._page is None:
            self._page = flight.page = LivePage(
                flight.controller,
                flight.commands,
                dict,
                mapper=flight.stats.mapper,
            )
        place = self.mission.frame.to_geodetic(self.mission.waypoints[3].position)
        if self.now_s > ASK_S and HOLD not in self._asked:
            self._ask(HOLD, {"request": "hold", "id": 1})
        elif self.now_s > ASK_S + 5 and GOTO not in self._asked:
            self._ask(GOTO, {"request": "goto", "id": 2, "points": [list(place)]})
        elif self.now_s > ASK_S + 10:
            raise SceneOverError

    def _ask(self, walk: Walk, request: dict[str, Any]) -> None:
        answers: list[str] = []

        class Outbox:
            def post(self, _kind: str, text: str) -> None:
                answers.append(text)

        def ask() -> None:
            answer = self._page._respond  # noqa: SLF001 - what the page's socket leads to
            self._asked[walk] = counted(lambda: answer(Outbox(), json.dumps(request)))
            if not json.loads(answers[0]).get("accepted"):
                raise SystemExit(f"{walk.name}: {answers[0]}")

        self._asked[walk] = Counts(0, 0, 0)
        self.call(ask)


# How it is measured.


def counted(call: Callable[[], Any]) -> Counts:
    """Make a call, and count what it passes through."""
    files: list[str] = []
    known: dict[CodeType, str | None] = {}

    def look(frame: FrameType, event: str, _: object) -> None:
        if event != "call":
            return
        code = frame.f_code
        if code not in known:
            known[code] = place_of(code)
        place = known[code]
        if place is not None:
            files.append(place)

    sys.setprofile(look)
    try:
        call()
    finally:
        sys.setprofile(None)
    changes = sum(one != other for one, other in pairwise(files))
    return Counts(len(files), len(set(files)), changes)


def place_of(code: CodeType) -> str | None:
    """The file of a function of ours; None: it is none."""
    path = Path(code.co_filename)
    package = path.relative_to(ROOT).parts[0] if path.is_relative_to(ROOT) else ""
    if package not in PACKAGES:
        return None
    return "geo" if package == "geo" else str(path)


def steps_of(stream: Stream, told: Any) -> Iterator[tuple[Step, Counts]]:
    """Every step of a stream with the way of its call."""
    for step in stream.steps:
        if told.reaction_s != step.reaction_s:
            told.reaction_s = step.reaction_s
        call, heard = told.call(step.t, step.event), []
        yield step, counted(lambda call=call, heard=heard: heard.extend([call()]))
        told.heard(heard[0])


def of_controller(name: str) -> dict[Walk, Counts]:
    """The ways through a controller in one stream."""
    stream = read(FOLDER / f"{name}{SUFFIX}")
    cruise: Counter[Counts] = Counter()
    found: dict[Walk, list[Counts]] = {}
    for step, counts in steps_of(stream, controller_of(stream.setup)):
        kind = step.event["kind"]
        entered = {one["to"] for one in step.decided if one["kind"] == "state"}
        moved = any(one["kind"].startswith("fly_to") for one in step.decided)
        if kind == "telemetry" and not step.decided:
            cruise[counts] += 1
        elif kind == "telemetry" and moved and "state:init" in entered:
            found.setdefault(BEGUN, []).append(counts)
        elif kind == "robot_pose" and "state:comm" in entered:
            found.setdefault(FOUND, []).append(counts)
        elif kind == "sync_ended" and moved and "state:expl" in entered:
            found.setdefault(SYNCED, []).append(counts)
    return {walk: min(each) for walk, each in found.items()} | {CRUISE: cruise.most_common(1)[0][0]}


def of_construction() -> Counts:
    """The way to a controller of a flight."""
    return counted(construction_of(read(FOLDER / f"{FLIGHT}{SUFFIX}").setup))


def of_frame() -> Counts:
    """The way of the first frame of a peer that brings one message."""
    stream = read(FOLDER / f"{SESSION}{SUFFIX}")
    node = Node(stream.setup)
    for step in stream.steps:
        kinds = [one["kind"] for one in step.decided]
        if step.event["kind"] == "reply" and kinds.count("message_stored") == 1:
            return counted(node.call(step.t, step.event))
        node.decide(step.t, step.event)
    raise SystemExit(f"no message arrives in {SESSION}")


def of_page() -> dict[Walk, Counts]:
    """The ways of two requests."""
    asked: dict[Walk, Counts] = {}
    AskingScenario(asked).fly()
    return asked


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.walks")
    parser.add_argument("--json", action="store_true", help="for programs")
    arguments = parser.parse_args()
    met = of_controller(RUN)
    found = of_controller(FLIGHT) | {walk: met[walk] for walk in (FOUND, SYNCED)}
    found |= of_page() | {MADE: of_construction(), FRAME: of_frame()}
    over = [w for w in WALKS if any(n > most for n, most in zip(found[w], w.budget, strict=True))]
    if arguments.json:
        rows = [
            {"walk": w.name, "now": found[w], "budget": w.budget, "before": w.before} for w in WALKS
        ]
        print(json.dumps({"over": [w.name for w in over], "walks": rows}, indent=1))
    else:
        print(f"{'calls / files / changes of file':<40}{'now':>15}{'budget':>15}{'2026-11-22':>15}")
        for w in WALKS:
            columns = (" / ".join(map(str, each)) for each in (found[w], w.budget, w.before))
            print(f"{w.name:<40}" + "".join(f"{each:>15}" for each in columns))
        print(f"{len(over)} of {len(WALKS)} over budget")
    return 1 if over else 0


if __name__ == "__main__":
    sys.exit(main())
