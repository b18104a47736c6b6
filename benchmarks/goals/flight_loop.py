"""How long the event loop of a flight is blocked at most, by a watchdog in the rehearsal.

Rehearsed flights in simulated time: between two turns of the loop the world goes on, so what is
timed is the flight's own. What another thread does on a companion is done at once here, and left
out. Walls are drawn around the vehicle, zones across its legs, and it is sent here and there.
"""

import asyncio
import gc
import statistics
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Self
from unittest import mock

from benchmarks.goals.figure import Conditions, Figure, UnmeasuredError
from sitl.rehearsal import Fault, Scene, SimulatedFlight, SimulatedLoop

MISSIONS = Path(__file__).parents[2] / "missions"
NAMES = ("pennovation", "urban")
SCENES = (Fault.NONE, Fault.WALL, Fault.RELOAD, Fault.REQUESTS)
BLOCKED_MS = 50


class Watchdog:
    """Times every turn of the loop from now on, in milliseconds of the processor."""

    def __init__(self) -> None:
        self.turns_ms: list[float] = []
        self._elsewhere_s = 0.0

    def __enter__(self) -> Self:
        run, execute = asyncio.Handle._run, SimulatedLoop.run_in_executor  # noqa: SLF001 - a turn

        def timed(handle: asyncio.Handle) -> None:
            self._elsewhere_s = 0.0
            began_s = time.process_time()
            run(handle)
            self.turns_ms.append((time.process_time() - began_s - self._elsewhere_s) * 1e3)

        def apart(loop: SimulatedLoop, *args: Any, **options: Any) -> Any:
            began_s = time.process_time()
            try:
                return execute(loop, *args, **options)
            finally:
                self._elsewhere_s += time.process_time() - began_s

        self._patches = [
            mock.patch.object(asyncio.Handle, "_run", timed),
            mock.patch.object(SimulatedLoop, "run_in_executor", apart),
        ]
        for patch in self._patches:
            patch.start()
        gc.freeze()  # as `air-router fly` does
        return self

    def __exit__(self, *_: object) -> None:
        gc.unfreeze()
        for patch in self._patches:
            patch.stop()


def measure(conditions: Conditions) -> Iterator[Figure]:
    """The longest turn in each mission."""
    for name in NAMES[: 1 if conditions.quick else None]:
        turns_ms: list[float] = []
        for fault in SCENES[: 1 if conditions.quick else None]:
            path = MISSIONS / name / "mission.yaml"
            with Watchdog() as watchdog:
                evidence = SimulatedFlight(Scene(fault, 0), path).fly()
            if evidence.exit_code:
                raise UnmeasuredError(f"{name}, {fault.name}: {evidence.outcome}")
            turns_ms += watchdog.turns_ms
        anchors = {"the median turn": statistics.median(turns_ms)}
        what = f"{name}: flight loop blocked, most"
        yield Figure(what, max(turns_ms), "ms", BLOCKED_MS, anchors=anchors)
