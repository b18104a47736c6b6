"""Several UAVs in one mission: each flies in its own layer, from its own home.

Separation does not depend on communication: each vehicle has its own altitude, and climbs and
descends only above its own home. Lower vehicles avoid the climb corridors above the homes of higher
ones like zones.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from air_router.files import Area, Findings
from air_router.files.missions import PlacedForm
from air_router.mission.tracking import TrackingMargin
from geo.airspace import Circle
from geo.frame import Point
from mocha_link.team import Problem

STANDING_SHARE: Final = 0.25
"""Greatest distance of a vehicle on the ground from its home, as a share of the homes' separation.
This leaves the same distance to the border of its climb corridor."""


@dataclass(frozen=True, slots=True)
class Layer:
    """The layer of one UAV of several.

    Attributes:
        uav: The UAV's name in the team.
        home: Its take-off and landing place.
        altitude_m: Its altitude above its own home.
        level_m: The same above a reference level common to all UAVs of the mission.
        explore: Whether it explores; False: it only searches.
    """

    uav: str
    home: Point
    altitude_m: float
    level_m: float
    explore: bool


def layers_of(placed: PlacedForm) -> tuple[Layer, ...]:
    """The layers of a mission's UAVs, in its order; empty for a single UAV."""
    heights = _heights_m(placed)
    common = None not in heights
    layers = []
    for uav, height_m in zip(placed.uavs, heights, strict=True):
        home = uav.home or placed.home
        altitude_m = uav.form.altitude_m or placed.form.altitude_m
        if home is not None:
            level_m = altitude_m + ((height_m or 0.0) if common else 0.0)
            layers.append(Layer(uav.name, home.position, altitude_m, level_m, uav.form.explore))
    return tuple(layers)


def variants(placed: PlacedForm, layers: Sequence[Layer]) -> list[PlacedForm]:
    """The mission (with a home) as each of its UAVs flies it; first that of `form.uav`."""
    form, heights = placed.form, _heights_m(placed)
    made = [
        replace(
            placed.with_settings(
                uav=uav.name,
                altitude_m=layer.altitude_m,
                home=form.home.model_copy(update={"altitude_amsl_m": height_m}),
            ),
            home=uav.home or placed.home,
            climb_corridors=_climb_corridors(placed, layers, layer),
            # Two UAVs in PX4's own Return must not choose the same rally point.
            rally_points=placed.rally_points if len(layers) == 1 else (),
        )
        for uav, layer, height_m in zip(placed.uavs, layers, heights, strict=True)
    ]
    return sorted(made, key=lambda variant: variant.form.uav != form.uav)


def check_fleet(placed: PlacedForm, layers: Sequence[Layer], findings: Findings) -> None:
    """Report layers or homes that are too close, and settings that layers exclude."""
    if len(placed.uavs) < 2:
        return
    planner = placed.form.planner
    distance_m = planner.clearance_m + TrackingMargin.of(planner, placed.form.speed_m_s).planned_m
    levels = list(zip(placed.uavs, layers, strict=True))
    homes_m = max(planner.home_separation_m, column_radius_m(placed) + distance_m)
    for (_, lower), (uav, layer) in itertools.combinations(levels, 2):
        apart_m = abs(layer.level_m - lower.level_m)
        if apart_m < planner.vertical_separation_m:
            findings.report(
                uav.keys,
                f"'{layer.uav}' flies {apart_m:g} m from the layer of '{lower.uav}', "
                f"{planner.vertical_separation_m:g} m are to lie between two "
                "(planner.vertical_separation_m); give them other altitudes",
                "layers-too-close",
            )
        apart_m = math.dist(layer.home, lower.home)
        if apart_m < homes_m:
            findings.report(
                uav.keys if uav.home is None else uav.home.keys,
                f"the homes of '{lower.uav}' and '{layer.uav}' are {apart_m:.1f} m apart, it takes "
                f"{homes_m:g} m (planner.home_separation_m, the clearance and the tracking "
                "margin); give each a home of its own",
                "homes-too-close",
            )
    if placed.form.altitudes_m:
        message = "several UAVs fly here, each in its own layer; remove 'altitudes_m'"
        findings.report(("altitudes_m",), message, "altitude-in-layers")
    for spot in placed.waypoints:
        if spot.altitude_m is not None:
            message = (
                f"{spot.label} has an altitude of its own, and several UAVs fly here, each in its "
                "own layer; remove it"
            )
            findings.report(spot.keys, message, "altitude-in-layers")
    if placed.rally_points:
        message = "rally points are not put on board: two UAVs could return to the same one"
        findings.note(("rally_points",), message, "rally-points-shared")


def column_radius_m(placed: PlacedForm) -> float:
    """Radius of the climb corridor above a home."""
    return placed.form.planner.home_separation_m / 2


def merge(findings: Findings, found: Sequence[tuple[str | None, Findings]]) -> None:
    """Add the findings of each UAV's variant; findings of some UAVs only name these."""
    findings.problems += _merged([(uav, each.problems) for uav, each in found], findings.problems)
    findings.notes += _merged([(uav, each.notes) for uav, each in found], findings.notes)


def _merged(
    lists: Sequence[tuple[str | None, Sequence[Problem]]], known: Sequence[Problem]
) -> list[Problem]:
    merged = []
    for problem in dict.fromkeys(itertools.chain.from_iterable(found for _, found in lists)):
        if problem in known:
            continue
        uavs = [str(uav) for uav, found in lists if problem in found]
        suffix = "" if len(uavs) == len(lists) else f" (for {' and '.join(uavs)})"
        merged.append(replace(problem, message=problem.message + suffix))
    return merged


def _climb_corridors(placed: PlacedForm, layers: Sequence[Layer], own: Layer) -> tuple[Area, ...]:
    """The climb corridors of higher UAVs, which cross this UAV's layer."""
    return tuple(
        Area(f"home of {uav.name}", Circle(layer.home, column_radius_m(placed)), uav.keys)
        for uav, layer in zip(placed.uavs, layers, strict=True)
        if layer.level_m > own.level_m
    )


def _heights_m(placed: PlacedForm) -> list[float | None]:
    """Ground elevation of each UAV's home above mean sea level; default: the mission's home."""
    own = [uav.home_altitude_amsl_m for uav in placed.uavs]
    return [placed.home_altitude_amsl_m if own_m is None else own_m for own_m in own]
