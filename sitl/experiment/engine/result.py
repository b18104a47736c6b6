"""What a run amounts to: the columns of its results, and the curves of the figures."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from itertools import cycle
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from sitl.experiment.engine.ages import USES, Held, Pair, mean_age_s, mean_value, peak_age_s
from sitl.experiment.engine.channel import Stage
from sitl.experiment.engine.engine import Run
from sitl.experiment.engine.exchange import AirtimeStats, Transmission

Numbers = npt.NDArray[np.float64]

BIN_S: Final = 10.0
"""Bandwidth is counted in bins of this length."""


def measured(run: Run) -> dict[str, float | int | None]:
    """The columns of a run; each name carries its unit. None: not defined in this run."""
    duration_s = run.settings.duration_s
    rows = _columns(run.airtime)
    contacts_s = np.array([contact.ended_s - contact.began_s for contact in run.contacts])
    times_s = np.array([visit.time_s for visit in run.goals])
    goals = len(run.town.goals)
    # The mean share of the goals that was reached, over time: more and sooner is more.
    area_percent = 100 * sum(1 - t / duration_s for t in times_s.tolist()) / goals if goals else 0.0
    busy = np.sort(_bin_bytes(rows, duration_s))[::-1]
    return {
        "goals_total": goals,
        "goals_found": len(times_s),
        "goals_found_percent": _share_percent(len(times_s), goals) or 0.0,
        "time_to_goal_mean_min": _or_none(np.mean, times_s / 60),
        "goal_rate_area_percent": area_percent,
        "goal_bound_gap_percent": 100 * run.goal_bound_share - area_percent,
        "goal_value_percent": _share_percent(area_percent / 100, run.goal_bound_share),
        "service_age_mean_s": service_age_s(run, run.held, duration_s),
        "service_value_percent": _service_value_percent(run),
        **airtime_measures(run.airtime, run.channel_sim.open, duration_s),
        "contacts": len(contacts_s),
        "contact_total_s": float(contacts_s.sum()),
        "contact_median_s": _or_none(np.median, contacts_s),
        "busiest_tenth_percent": _share_percent(busy[: len(busy) // 10].sum(), busy.sum()),
        "silent_percent": _share_percent((busy == 0).sum(), len(busy)),
        "delivered_MB": _delivered_bytes(run) / 1e6,
        **(run.link_scores.measures() if run.link_scores else {}),
        **_ages(run),
        "map_known_percent": 100 * run.uavs[0].painter.known_share if run.uavs else 0.0,
        "map_area_percent": 100 * run.map_known_share,
        "errand_percent": _errand_percent(run),
        "driven_km": _way_m(run, "ugv") / 1e3,
        "flown_km": _way_m(run, "uav") / 1e3,
        "decisions": run.log.actions,
        "wall_s": run.wall_s,
        "cpu_s": run.cpu_s,
        "speed_up": duration_s / run.wall_s if run.wall_s > 0 else None,
    }


def airtime_measures(
    airtime: AirtimeStats, unfinished: int, duration_s: float
) -> dict[str, float | int | None]:
    """The columns of what was on the air.

    Args:
        airtime: What was noted.
        unfinished: Pulls that are under way or wait at the end.
        duration_s: Of the run.
    """
    rows = _columns(airtime)
    waits_s = _waits_s(rows, Stage, "start_s")
    return {
        **_of_waits(rows),
        "wait_median_s": _or_none(np.median, waits_s),
        "wait_p95_s": _or_none(np.percentile, waits_s, 95),
        "wait_max_s": _or_none(np.max, waits_s),
        "exchanges_complete": airtime.complete,
        "exchanges_broken": airtime.broken,
        "exchanges_open": unfinished,
        "exchanges_complete_percent": _share_percent(
            airtime.complete, airtime.complete + airtime.broken
        ),
        "transmissions": len(airtime.transmissions),
        "sent_MB": float(rows["bytes"][rows["complete"] > 0].sum()) / 1e6,
        "channel_busy_percent": 100 * float((rows["end_s"] - rows["start_s"]).sum()) / duration_s,
    }


def curves(run: Run) -> dict[str, Any]:
    """What the figures show of a run that is over, in plain values."""
    duration_s = run.settings.duration_s
    return {
        "goals": [[visit.goal, round(visit.time_s, 1), visit.robot] for visit in run.goals],
        "bin_bytes": _bin_bytes(_columns(run.airtime), duration_s).astype(int).tolist(),
        "pairs": [
            [*pair, mean_age_s(held, duration_s), peak_age_s(held, duration_s)]
            for pair, held in run.held.items()
        ],
        **({"links": run.link_scores.bins()} if run.link_scores else {}),
    }


def _errand_percent(run: Run) -> float | None:
    """The share of robots' time that their policy had them elsewhere; None: none has a policy."""
    if run.settings.explorer.policy is None or not run.robots:
        return None
    spent_s = sum(robot.errand_s for robot in run.robots.values())
    return 100 * spent_s / (len(run.robots) * run.settings.duration_s)


def _delivered_bytes(run: Run) -> int:
    """Bytes of data that arrived whole over links of UAVs, either way."""
    uavs = {number for number, kind in enumerate(run.fleet.kinds) if kind == "uav"}
    return sum(
        sent.bytes
        for sent in run.airtime.transmissions
        if sent.complete and sent.stage == Stage.DATA and {sent.requesting, sent.answering} & uavs
    )


_COUNTED: Final = {"": tuple(Stage), "data_": (Stage.DATA,), "header_": (Stage.HEADER,)}
"""Which stages' transmissions are messages."""


def _of_waits(rows: Mapping[str, Numbers]) -> dict[str, float | int | None]:
    """How many messages waited and how long, by what is counted: see `settings.MessageWait`."""
    found: dict[str, float | int | None] = {}
    for name, stages in _COUNTED.items():
        for what, until in (("wait", "start_s"), ("delay", "end_s")):
            times_s = _waits_s(rows, stages, until)
            found[f"{name}waits"] = len(times_s)
            found[f"{name}{what}_mean_s"] = _or_none(np.mean, times_s)
            found[f"{name}{what}_sd_s"] = _or_none(np.std, times_s)
    return found


def _waits_s(rows: Mapping[str, Numbers], stages: Iterable[Stage], until: str) -> Numbers:
    """The paper's message wait: how long each message that got through waited.

    From the moment when it was its turn in its own exchange to the beginning (`until`: start_s) or
    the end (end_s) of the transmission that brought it over. Time out of contact counts where
    exchanges are held. In the paper's counting requests and ends of exchanges are messages too. Of
    several that crossed together each has waited.
    """
    through = (rows["complete"] > 0) & np.isin(rows["stage"], list(stages))
    waits_s: Numbers = (rows[until] - rows["ready_s"])[through]
    return np.repeat(waits_s, np.maximum(rows["messages"][through], 1).astype(np.intp))


def _columns(airtime: AirtimeStats) -> dict[str, Numbers]:
    """The transmissions' fields."""
    table = np.array(airtime.transmissions, np.float64).reshape(-1, len(Transmission._fields))
    return dict(zip(Transmission._fields, table.T, strict=True))


def _bin_bytes(rows: Mapping[str, Numbers], duration_s: float) -> Numbers:
    """Bytes that arrived in each `BIN_S` of the run: bandwidth over time."""
    through = rows["complete"] > 0
    edges = np.arange(0.0, duration_s + BIN_S, BIN_S)
    counts, _ = np.histogram(rows["end_s"][through], bins=edges, weights=rows["bytes"][through])
    return counts


def _ages(run: Run) -> dict[str, float | None]:
    """Columns for each topic: means over its pairs of their mean and of their peak age."""
    found: dict[str, float | None] = {}
    for name, _, _ in USES.values():
        held = [own for (topic, _, _), own in run.held.items() if topic == name]
        for what, age_s in (("mean", mean_age_s), ("peak", peak_age_s)):
            ages_s = [
                age for own in held if (age := age_s(own, run.settings.duration_s)) is not None
            ]
            found[f"{name}_age_{what}_s"] = _or_none(np.mean, np.array(ages_s))
    return found


def service_age_s(run: Run, held_by: Mapping[Pair, Held], end_s: float) -> float | None:
    """The mean age of poses at UAVs and of UAVs' maps, robots weighted by their values.

    Args:
        run: It need not be over.
        held_by: What its robots have held of each other so far.
        end_s: From the beginning until then.
    """
    values = dict(zip(run.fleet.ugvs, cycle(run.settings.values or (1.0,)), strict=False))
    ages_s, weights = [], []
    for (topic, maker, user), held in held_by.items():
        if topic in {"pose", "map"}:
            ages_s.append(mean_age_s(held, end_s))
            weights.append(values[maker if topic == "pose" else user])
    return float(np.average(ages_s, weights=weights)) if ages_s else None


HALF_LIFE_S: Final = 300.0
"""What a robot holds of another one is worth half as much for each such time of its age."""


def _service_value_percent(run: Run) -> float | None:
    """What poses at UAVs and UAVs' maps at robots are worth on average, of what fresh ones are."""
    values = [
        mean_value(held, run.settings.duration_s, HALF_LIFE_S)
        for (topic, _, _), held in run.held.items()
        if topic in {"pose", "map"}
    ]
    return 100 * float(np.mean(values)) if values else None


def _share_percent(part: Any, whole: Any) -> float | None:
    return 100 * float(part) / float(whole) if whole else None


def _way_m(run: Run, kind: str) -> float:
    ways = zip(run.fleet.kinds, run.travelled_m.tolist(), strict=True)
    return sum(way_m for own, way_m in ways if own == kind)


def _or_none(function: Callable[..., Any], values: Numbers, *more: float) -> float | None:
    return float(function(values, *more)) if values.size else None
