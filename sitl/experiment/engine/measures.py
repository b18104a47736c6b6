"""What a run amounts to: one number per column of the results, and the curves of the figures."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from sitl.experiment.engine.result import RunResult

Numbers = npt.NDArray[np.float64]

WAIT_EDGES_S: Final = np.concatenate(([0.0], np.logspace(-3, 4, 57)))
"""Waits are counted in these bins: at once (below 1 ms), then eight to every power of ten."""

BIN_S: Final = 10.0
"""Bandwidth is counted in bins of this length."""

CURVE_S: Final = 60.0
"""Ages and shares are kept so often."""


def measured(result: RunResult, duration_s: float) -> dict[str, float | int | None]:
    """The columns of a run; each name carries its unit. None: not defined in this run."""
    waits_s = result.waits_s
    rows = result.transmissions
    contacts_s = result.contacts["ended_s"] - result.contacts["began_s"]
    ended = result.exchanges_complete + result.exchanges_broken
    time_s = result.mean_time_to_goal_s
    ages_s = _ages_s(result)
    ground = _of_kind(result, "ugv")
    pair = ~np.eye(len(result.robots), dtype=bool)
    return {
        "goals_total": result.goals_total,
        "goals_found": len(result.goals),
        "goals_found_percent": 100 * result.goals_share,
        "time_to_goal_mean_min": None if time_s is None else time_s / 60,
        "goal_rate_area_percent": _area_percent(result, duration_s),
        "waits": len(waits_s),
        "wait_mean_s": _or_none(waits_s, np.mean),
        "wait_sd_s": _or_none(waits_s, np.std),
        "wait_median_s": _or_none(waits_s, np.median),
        "wait_p95_s": _or_none(waits_s, lambda values: np.percentile(values, 95)),
        "wait_max_s": _or_none(waits_s, np.max),
        "exchanges_complete": result.exchanges_complete,
        "exchanges_broken": result.exchanges_broken,
        "exchanges_open": result.exchanges_open,
        "exchanges_complete_percent": 100 * result.exchanges_complete / ended if ended else None,
        "transmissions": len(rows),
        "sent_MB": float(rows["bytes"][rows["complete"]].sum()) / 1e6,
        "channel_busy_percent": 100 * float((rows["end_s"] - rows["start_s"]).sum()) / duration_s,
        "contacts": len(contacts_s),
        "contact_total_s": float(contacts_s.sum()),
        "contact_median_s": _or_none(contacts_s, np.median),
        "pose_age_mean_s": float(ages_s[:, pair].mean()) if pair.any() and len(ages_s) else None,
        "map_age_mean_s": _or_none(_map_ages_s(result)[:, ground], np.mean),
        "map_known_percent": 100 * float(result.known_share[-1]) if len(ages_s) else None,
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
    counts, _ = np.histogram(result.waits_s, bins=WAIT_EDGES_S)
    times_s = result.sample_times_s
    step = max(1, round(CURVE_S / (times_s[1] - times_s[0]))) if len(times_s) > 1 else 1
    ages_s, count = _ages_s(result), len(result.robots)
    others = max(count - 1, 1)
    kept: dict[str, Any] = {
        "robots": list(result.robots),
        "kinds": list(result.kinds),
        "goals": [[v.goal, round(v.time_s, 1), v.robot] for v in result.goals],
        "wait_counts": _trimmed(counts),
        "bin_bytes": [int(v) for v in result.bytes_per_bin(BIN_S, duration_s)],
        "contacts": _meetings(result),
        "curve_times_s": [round(float(v), 1) for v in times_s[::step]],
        "pose_age_s": _rounded(ages_s.sum(axis=1)[::step] / others),  # [time][whose pose]
        "map_age_s": _rounded(_map_ages_s(result)[::step]),
        "known_share": _rounded(result.known_share[::step], 4),
    }
    if places:
        kept["goal_places_m"] = [[goal, *map(float, place)] for goal, place in result.goal_places]
        kept["place_times_s"] = [round(float(v), 1) for v in times_s]
        kept["places_m"] = _rounded(result.positions_m)
        kept["states"] = [[uav, round(t, 1), state] for uav, t, state in result.states]
    return kept


def _of_kind(result: RunResult, kind: str) -> npt.NDArray[np.bool_]:
    return np.array([own == kind for own in result.kinds], dtype=bool)


def _ages_s(result: RunResult) -> Numbers:
    """(samples, who knows, of whom): who has never heard of a robot is as old as the run."""
    times_s = result.sample_times_s[:, None, None]
    return np.minimum(result.pose_age_s.astype(np.float64), times_s)


def _map_ages_s(result: RunResult) -> Numbers:
    return np.minimum(result.map_age_s.astype(np.float64), result.sample_times_s[:, None])


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
