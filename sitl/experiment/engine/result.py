"""What one simulated run has shown, and what it amounts to: data, columns, curves of figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from geo.frame import Point
from geo.grid import Terrain
from sitl.experiment.engine.ages import USES, Held, Pair, ages_at, mean_age_s, peak_age_s
from sitl.world.terrain import Raster

TRANSMISSION: Final = np.dtype(
    [
        ("ready_s", "f8"),  # when it could have begun, had the channel been free
        ("start_s", "f8"),
        ("end_s", "f8"),
        ("asking", "i2"),  # index in `robots` of who pulls
        ("answering", "i2"),  # of whom it is pulled from
        ("stage", "u1"),  # index in STAGES
        ("messages", "i4"),  # robots' messages in it
        ("bytes", "i8"),  # request and replies; of an interrupted one as far as it came
        ("complete", "?"),
    ]
)
"""One row per transmission. What was interrupted and sent again later has a row for each try, all
with the same `ready_s`."""

STAGES: Final = ("header", "data", "end")

CONTACT: Final = np.dtype([("began_s", "f8"), ("ended_s", "f8"), ("a", "i2"), ("b", "i2")])
"""One row per contact; one that lasts ends with the run."""


class GoalVisit(NamedTuple):
    """A goal that a robot reached for the first time, seconds from the start."""

    goal: str
    time_s: float
    robot: str


@dataclass(frozen=True, slots=True, eq=False)
class RunResult:
    """One run.

    Attributes:
        seed: What it was run with.
        robots: Names, sorted; arrays below have them in this order.
        kinds: What each is: "uav", "ugv" or "base".
        travelled_m: How far each has come.
        values: How much the service of each ground robot counts.
        goals_total: How many goals the town has.
        goal_bound_share: At most this share of the goals can be reached, in the mean over time.
        goal_places: Id and place of each, in metres east and north.
        goals: Those that were reached, in order of time.
        transmissions: TRANSMISSION rows in order of their end.
        contacts: CONTACT rows in order of their beginning.
        exchanges_complete: Pulls that came to their end.
        exchanges_broken: Pulls that lost contact before their end and were given up.
        exchanges_open: Pulls that were still under way, or waiting, when the run ended.
        sample_times_s: When the following were sampled.
        positions_m: (samples, robots, 2): east, north.
        held: What robots held of each other, as `ages` has it.
        known_share: (samples,): share of the town's ground that the first UAV's map shows.
        states: (UAV, time, state) for every change of a UAV's mission.
        decisions: How many actions the controllers asked for.
        digest: SHA-256 of the event log, in hex: equal digests are equal runs.
        wall_s: What the run took.
        cpu_s: Processor time of it.
    """

    seed: int
    robots: tuple[str, ...]
    kinds: tuple[str, ...]
    travelled_m: tuple[float, ...]
    values: tuple[float, ...]
    goals_total: int
    goal_bound_share: float
    goal_places: tuple[tuple[str, Point], ...]
    goals: tuple[GoalVisit, ...]
    transmissions: npt.NDArray[np.void]
    contacts: npt.NDArray[np.void]
    exchanges_complete: int
    exchanges_broken: int
    exchanges_open: int
    sample_times_s: npt.NDArray[np.float64]
    positions_m: npt.NDArray[np.float32]
    held: Mapping[Pair, Held]
    known_share: npt.NDArray[np.float32]
    states: tuple[tuple[str, float, str], ...]
    decisions: int
    digest: str
    wall_s: float
    cpu_s: float

    def waits_s(self, *stages: str) -> npt.NDArray[np.float64]:
        """The paper's message wait: how long each message that got through waited for the channel.

        From the moment when it was its turn in its own exchange to the beginning of the
        transmission that brought it over. Time out of contact counts where exchanges are held.
        In the paper's counting requests and ends of exchanges are messages too. Of several that
        crossed together each has waited.

        Args:
            stages: of these only; default: all.
        """
        rows = self.transmissions[self.transmissions["complete"]]
        if stages:
            rows = rows[np.isin(rows["stage"], [STAGES.index(stage) for stage in stages])]
        waits: npt.NDArray[np.float64] = rows["start_s"] - rows["ready_s"]
        return np.repeat(waits, np.maximum(rows["messages"], 1))

    def bytes_per_bin(self, bin_s: float, duration_s: float) -> npt.NDArray[np.float64]:
        """Bytes that arrived in each `bin_s` of the run: bandwidth over time."""
        edges = np.arange(0.0, duration_s + bin_s, bin_s)
        rows = self.transmissions[self.transmissions["complete"]]
        counts, _ = np.histogram(rows["end_s"], bins=edges, weights=rows["bytes"])
        return counts


Numbers = npt.NDArray[np.float64]

WAIT_EDGES_S: Final = np.concatenate(([0.0], np.logspace(-3, 4, 57)))
"""Waits are counted in these bins: at once (below 1 ms), then eight to every power of ten."""

BIN_S: Final = 10.0
"""Bandwidth is counted in bins of this length."""

CURVE_S: Final = 60.0
"""Ages and shares are kept so often."""

DISTANCES_M: Final = np.arange(0.0, 161.0, 4.0)
BUILDINGS_M: Final = np.array([0.0, 0.5, 2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 60.0])
_LINE_STEPS: Final = 80
"""A line between two robots is looked at in so many places: every two metres at the farthest."""


def measured(result: RunResult, duration_s: float) -> dict[str, float | int | None]:
    """The columns of a run; each name carries its unit. None: not defined in this run."""
    waits_s, data_s, header_s = (result.waits_s(*own) for own in ((), ("data",), ("header",)))
    rows = result.transmissions
    contacts_s = result.contacts["ended_s"] - result.contacts["began_s"]
    ended = result.exchanges_complete + result.exchanges_broken
    times_s = np.array([visit.time_s for visit in result.goals])
    busy = np.sort(result.bytes_per_bin(BIN_S, duration_s))[::-1]
    return {
        "goals_total": result.goals_total,
        "goals_found": len(result.goals),
        "goals_found_percent": _share_percent(len(times_s), result.goals_total) or 0.0,
        "time_to_goal_mean_min": _or_none(times_s / 60, np.mean),
        "goal_rate_area_percent": _area_percent(result, duration_s),
        "goal_bound_gap_percent": 100 * result.goal_bound_share - _area_percent(result, duration_s),
        "service_age_mean_s": _service_age_s(result, duration_s),
        "waits": len(waits_s),
        "wait_mean_s": _or_none(waits_s, np.mean),
        "wait_sd_s": _or_none(waits_s, np.std),
        "wait_median_s": _or_none(waits_s, np.median),
        "wait_p95_s": _or_none(waits_s, lambda values: np.percentile(values, 95)),
        "wait_max_s": _or_none(waits_s, np.max),
        "data_waits": len(data_s),
        "data_wait_mean_s": _or_none(data_s, np.mean),
        "header_waits": len(header_s),
        "header_wait_mean_s": _or_none(header_s, np.mean),
        "exchanges_complete": result.exchanges_complete,
        "exchanges_broken": result.exchanges_broken,
        "exchanges_open": result.exchanges_open,
        "exchanges_complete_percent": _share_percent(result.exchanges_complete, ended),
        "transmissions": len(rows),
        "sent_MB": float(rows["bytes"][rows["complete"]].sum()) / 1e6,
        "channel_busy_percent": 100 * float((rows["end_s"] - rows["start_s"]).sum()) / duration_s,
        "contacts": len(contacts_s),
        "contact_total_s": float(contacts_s.sum()),
        "contact_median_s": _or_none(contacts_s, np.median),
        "busiest_tenth_percent": _share_percent(busy[: len(busy) // 10].sum(), busy.sum()),
        "silent_percent": _share_percent((busy == 0).sum(), len(busy)),
        **_ages(result, duration_s),
        "map_known_percent": 100 * float(result.known_share[-1])
        if result.known_share.size
        else None,
        "driven_km": _way_m(result, "ugv") / 1e3,
        "flown_km": _way_m(result, "uav") / 1e3,
        "decisions": result.decisions,
        "wall_s": result.wall_s,
        "cpu_s": result.cpu_s,
        "speed_up": duration_s / result.wall_s if result.wall_s > 0 else None,
    }


def curves(result: RunResult, duration_s: float, *, places: bool) -> dict[str, Any]:
    """What the figures show of a run, in plain values.

    Args:
        result: the run.
        duration_s: its simulated time.
        places: keep positions and the states of UAVs too, which are long.
    """
    counts, _ = np.histogram(result.waits_s(), bins=WAIT_EDGES_S)
    times_s = result.sample_times_s
    step = max(1, round(CURVE_S / (times_s[1] - times_s[0]))) if len(times_s) > 1 else 1
    kept: dict[str, Any] = {
        "robots": list(result.robots),
        "kinds": list(result.kinds),
        "goals": [[v.goal, round(v.time_s, 1), v.robot] for v in result.goals],
        "wait_counts": _trimmed(counts),
        "bin_bytes": [int(v) for v in result.bytes_per_bin(BIN_S, duration_s)],
        "contacts": _meetings(result),
        "curve_times_s": [round(float(v), 1) for v in times_s[::step]],
        "pairs": [
            [*pair, mean_age_s(held, duration_s), peak_age_s(held, duration_s)]
            for pair, held in result.held.items()
        ],
        "pose_age_s": _age_curves(result, "pose", 1, times_s[::step]),  # [ground robot][time]
        "map_age_s": _age_curves(result, "map", 2, times_s[::step]),
        "known_share": _rounded(result.known_share[::step], 4),
    }
    if places:
        kept["goal_places_m"] = [[goal, *map(float, place)] for goal, place in result.goal_places]
        kept["place_times_s"] = [round(float(v), 1) for v in times_s]
        kept["places_m"] = _rounded(result.positions_m)
        kept["states"] = [[uav, round(t, 1), state] for uav, t, state in result.states]
    return kept


def seen_links(result: RunResult, raster: Raster) -> list[list[list[int]]]:
    """Cases of a run, counted: [distance][building] = [cases, in contact].

    Each sample is a case for every pair of robots on the ground: their distance, how many metres of
    building lie between them, and whether they were in contact.
    """
    ground = [i for i, kind in enumerate(result.kinds) if kind != "uav"]
    counts = np.zeros((len(DISTANCES_M) - 1, len(BUILDINGS_M) - 1, 2), dtype=np.int64)
    contacts = result.contacts
    for place, a in enumerate(ground):
        for b in ground[place + 1 :]:
            own = contacts[
                ((contacts["a"] == a) & (contacts["b"] == b))
                | ((contacts["a"] == b) & (contacts["b"] == a))
            ]
            times_s = result.sample_times_s[:, None]
            linked = ((own["began_s"] <= times_s) & (times_s < own["ended_s"])).any(axis=1)
            start, end = (result.positions_m[:, i].astype(np.float64) for i in (a, b))
            away_m = np.hypot(*(end - start).T)
            between_m = _building_m(start, end, away_m, raster)
            for column, chosen in ((0, np.ones_like(linked)), (1, linked)):
                found, _, _ = np.histogram2d(
                    away_m[chosen], between_m[chosen], bins=(DISTANCES_M, BUILDINGS_M)
                )
                counts[..., column] += found.astype(np.int64)
    plain: list[list[list[int]]] = counts.tolist()
    return plain


def _building_m(start: Numbers, end: Numbers, away_m: Numbers, raster: Raster) -> Numbers:
    """Metres of building between places."""
    along = ((np.arange(_LINE_STEPS) + 0.5) / _LINE_STEPS)[None, :, None]
    points = start[:, None] + along * (end - start)[:, None]
    hit = raster.classes_at(points[..., 0], points[..., 1]) == Terrain.BUILDING
    result: Numbers = hit.mean(axis=1) * away_m
    return result


def _ages(result: RunResult, duration_s: float) -> dict[str, float | None]:
    """Columns for each topic: means over its pairs of their mean and of their peak age."""
    found: dict[str, float | None] = {}
    for name, _, _ in USES.values():
        held = [own for (topic, _, _), own in result.held.items() if topic == name]
        for what, age_s in (("mean", mean_age_s), ("peak", peak_age_s)):
            ages_s = [age for own in held if (age := age_s(own, duration_s)) is not None]
            found[f"{name}_age_{what}_s"] = _or_none(np.array(ages_s), np.mean)
    return found


def _service_age_s(result: RunResult, duration_s: float) -> float | None:
    """The mean age of poses at UAVs and of UAVs' maps, robots weighted by their values."""
    ground = [name for name, kind in zip(result.robots, result.kinds, strict=True) if kind == "ugv"]
    values = dict(zip(ground, result.values, strict=True))
    ages_s, weights = [], []
    for (topic, maker, user), held in result.held.items():
        if topic in {"pose", "map"}:
            ages_s.append(mean_age_s(held, duration_s))
            weights.append(values[maker if topic == "pose" else user])
    return float(np.average(ages_s, weights=weights)) if ages_s else None


def _age_curves(result: RunResult, topic: str, by: int, times_s: Numbers) -> list[Any]:
    """Ages of a topic over time, by the first or second robot of a pair: means over the others."""
    found: dict[str, list[Numbers]] = {}
    for pair, held in result.held.items():
        if pair[0] == topic:
            found.setdefault(pair[by], []).append(ages_at(held, times_s))
    return [_rounded(np.mean(own, axis=0)) for own in found.values()]


def _share_percent(part: Any, whole: Any) -> float | None:
    return 100 * float(part) / float(whole) if whole else None


def _area_percent(result: RunResult, duration_s: float) -> float:
    """Mean share of the goals that was reached, over time: more and sooner is more."""
    if not result.goals_total:
        return 0.0
    return 100 * sum(1 - v.time_s / duration_s for v in result.goals) / result.goals_total


def _way_m(result: RunResult, kind: str) -> float:
    ways = zip(result.kinds, result.travelled_m, strict=True)
    return float(sum(way_m for own, way_m in ways if own == kind))


def _meetings(result: RunResult) -> list[list[float]]:
    """Who met whom: indices of both, how often, how long in all."""
    found: dict[tuple[int, int], list[float]] = {}
    for contact in result.contacts:
        a, b = sorted((int(contact["a"]), int(contact["b"])))
        entry = found.setdefault((a, b), [0, 0.0])
        entry[0] += 1
        entry[1] += float(contact["ended_s"] - contact["began_s"])
    return [[a, b, n, round(s, 1)] for (a, b), (n, s) in sorted(found.items())]


def _or_none(values: npt.NDArray[Any], function: Any) -> float | None:
    return float(function(values)) if values.size else None


def _rounded(values: npt.NDArray[Any], digits: int = 1) -> list[Any]:
    plain: list[Any] = np.round(values.astype(np.float64), digits).tolist()
    return plain


def _trimmed(counts: npt.NDArray[Any]) -> list[int]:
    """Counts without the empty bins at their end."""
    last = int(np.max(np.nonzero(counts)[0], initial=-1))
    return [int(v) for v in counts[: last + 1]]
