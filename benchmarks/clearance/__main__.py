"""`python -m benchmarks.clearance`: true distance of flights from zones and fences.

Flies missions with a clearance of 3 m at 2 to 8 m/s, in still air and in gusty wind, against the
simulated autopilot, which simulates position errors. With --px4 also against a real PX4 SITL, which
sends its true position on a separate port and has no wind. Prints a row for each speed and wind:

* kept: least distance beyond the clearance over all flights; negative: the clearance was violated
* outside: how far the true track left the area checked for its legs, by the kinds of
  `measure.Used`, and the deviation that `air_router.mission.tracking` predicts
* off: difference between reported and true position

The exit code is 1 if a flight violated its clearance.
"""

from __future__ import annotations

import argparse
import json
import logging
import sys
from collections import defaultdict
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import yaml

from air_router.files import PlannerSettings
from air_router.mission import BREEZE_M_S, TrackingMargin
from benchmarks.clearance.measure import Figures, figures
from sitl.px4sim.motion import WindSettings
from sitl.rehearsal import Fault, Scene, SimulatedFlight
from sitl.rehearsal.programs import RealFlight, WireScene

MISSIONS = Path(__file__).parents[2] / "missions"
SPEEDS_M_S = (2.0, 3.5, 5.0, 6.5, 8.0)
WINDS_M_S = (0.0, 3.0, 5.0, 8.0)
CLEARANCE_M = 3.0
MOST_CORNERS_M_S = 5.0
NAMES = ("pennovation", "urban")
GUSTS = 0.3  # spread of gusts, of the mean wind
REAL_SPEED = 5.0  # of a real PX4, times real time
REAL_DURATION_S = 90


@dataclass(frozen=True, slots=True)
class Flight:
    """One flight: which mission, how fast, in what wind; `px4`: of a real one."""

    mission: str
    speed_m_s: float
    wind_m_s: float
    seed: int
    px4: str | None = None

    @property
    def path(self) -> Path:
        """Of the mission file."""
        return MISSIONS / self.mission / "mission.yaml"

    @property
    def planner(self) -> dict[str, Any]:
        """Of the mission file, planned for this wind."""
        own = yaml.safe_load(self.path.read_text(encoding="utf-8")).get("planner") or {}
        wind_m_s = max(self.wind_m_s, PlannerSettings().wind_m_s)
        # The shortest ways pass the corners of zones as near as they may.
        return {**own, "kind": "shortest", "clearance_m": CLEARANCE_M, "wind_m_s": wind_m_s}

    def fly(self) -> Figures:
        """From power-on to the end, and what it kept."""
        keys: dict[str, Any] = {"speed_m_s": self.speed_m_s, "planner": self.planner}
        if self.px4 is not None:
            keys |= {"duration_s": REAL_DURATION_S}
            scene = WireScene(Fault.NONE, self.seed)
            real = RealFlight(scene, self.path.absolute(), REAL_SPEED, self.px4, keys=keys)
            return figures(real.fly())
        wind = WindSettings(self.wind_m_s, self.seed * 73.0 % 360.0, GUSTS * self.wind_m_s)
        # An operator of a rehearsal requests places that a flight at 5 m/s may reach.
        corners = (
            self.seed % 2 and self.speed_m_s <= MOST_CORNERS_M_S and self.wind_m_s <= BREEZE_M_S
        )
        scene = Scene(Fault.CORNERS if corners else Fault.NONE, self.seed)
        return figures(SimulatedFlight(scene, self.path, keys=keys, wind=wind).fly())


def flights(number: int, px4: str | None = None) -> Iterable[Flight]:
    """So many, each speed and wind as often; a real PX4 flies in still air."""
    winds = WINDS_M_S if px4 is None else WINDS_M_S[:1]
    cells = [(speed_m_s, wind_m_s) for speed_m_s in SPEEDS_M_S for wind_m_s in winds]
    for index in range(number):
        again, cell = divmod(index, len(cells))
        name = NAMES[again % len(NAMES)] if px4 is None else NAMES[0]
        yield Flight(name, *cells[cell], seed=index, px4=px4)


def fly(flight: Flight) -> Figures:
    """One flight in a process of its own."""
    logging.disable(logging.ERROR)
    return flight.fly()


def main() -> int:
    """Fly, and print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.clearance", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument(
        "--flights", type=int, default=40, metavar="N", help="number of simulated flights (40)"
    )
    parser.add_argument("--px4", metavar="PATH", help="also fly this PX4")
    parser.add_argument(
        "--px4-flights", type=int, default=10, metavar="N", help="number of flights with PX4 (10)"
    )
    parser.add_argument(
        "--jobs", type=int, default=2, metavar="N", help="number of parallel simulated flights (2)"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write every flight to FILE")
    arguments = parser.parse_args()
    flown: list[tuple[Flight, Figures]] = []
    with ProcessPoolExecutor(arguments.jobs) as pool:
        chosen = list(flights(arguments.flights))
        for flight, found in zip(chosen, pool.map(fly, chosen), strict=True):
            flown.append(_logged(flight, found))
    real = flights(arguments.px4_flights if arguments.px4 else 0, arguments.px4)
    flown.extend(_logged(flight, flight.fly()) for flight in real)
    sys.stdout.write(table(flown) + "\n")
    if arguments.json:
        rows = [asdict(flight) | asdict(found) for flight, found in flown]
        arguments.json.write_text(json.dumps(rows, indent=1), encoding="utf-8")
    return 1 if any(found.spare_m < 0.0 for _, found in flown) else 0


def _logged(flight: Flight, found: Figures) -> tuple[Flight, Figures]:
    """Log each flight as it ends: all of them take minutes."""
    sys.stderr.write(f"{flight}: {found.end}, {found.spare_m:+.2f} m beyond the clearance\n")
    return flight, found


def table(flown: Iterable[tuple[Flight, Figures]]) -> str:
    """Markdown."""
    groups: defaultdict[tuple[bool, float, float], list[tuple[Flight, Figures]]] = defaultdict(list)
    for flight, found in flown:
        groups[flight.px4 is not None, flight.speed_m_s, flight.wind_m_s].append((flight, found))
    head = (
        *("autopilot", "m/s", "wind m/s", "flights", "legs", "kept", "straight", "turn", "end"),
        *("reckoned", "off"),
    )
    lines = [f"| {' | '.join(head)} |", "|" + "---|" * len(head)]
    for (px4, speed_m_s, wind_m_s), mine in sorted(groups.items()):
        margin = TrackingMargin.of(_settings(mine[0][0]), speed_m_s)
        found = [each for _, each in mine]
        legs = sum(len(each.used) for each in found)
        used_m = [max(each.most_m(kind) for each in found) for kind in ("straight", "turn", "end")]
        cells = (
            *("PX4" if px4 else "simulated", f"{speed_m_s:g}", f"{wind_m_s:g}", f"{len(mine)}"),
            *(f"{legs}", f"{min(each.spare_m for each in found):+.2f}"),
            *(f"{metres:.2f}" for metres in used_m),
            *(f"{margin.turn_m:.2f}", f"{max(each.off_m for each in found):.2f}"),
        )
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _settings(flight: Flight) -> PlannerSettings:
    return PlannerSettings(**flight.planner)


if __name__ == "__main__":
    sys.exit(main())
