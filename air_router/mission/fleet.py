"""Several UAVs in one mission: each flies a layer of its own, from a home of its own.

Two vehicles keep apart because of where they may be, not because they hear of each other. Each
flies at its own altitude; only above its own home it climbs and descends. A vehicle that flies
lower keeps away from the climb corridors above the homes of those that fly higher, as from zones.
"""

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final

from air_router.files import Area, MissionDocument, Uav
from air_router.mission.tracking import TrackingMargin
from geo.airspace import Circle
from geo.frame import Point
from mocha_link.team import Problem

STANDING_SHARE: Final = 0.25
"""A vehicle takes off where it stands: that is at most this share of the homes' separation away
from its home, which leaves as much between it and the border of its climb corridor."""


@dataclass(frozen=True, slots=True)
class Layer:
    """Where one UAV of several flies.

    Attributes:
        uav: Its name in the team.
        home: Where it takes off and lands.
        altitude_m: Where it flies, above its own home.
        level_m: The same above a level that is common to all UAVs of the mission.
        explore: It explores, and does not only search.
    """

    uav: str
    home: Point
    altitude_m: float
    level_m: float
    explore: bool


def layers_of(draft: MissionDocument) -> tuple[Layer, ...]:
    """The layers of a draft, in its order; empty if it speaks of one UAV only."""
    heights = [_height_m(draft, uav) for uav in draft.uavs]
    common = None not in heights
    layers = []
    for uav, height_m in zip(draft.uavs, heights, strict=True):
        home = uav.home or draft.home
        altitude_m = draft.altitude_m if uav.altitude_m is None else uav.altitude_m
        if home is not None:
            level_m = altitude_m + ((height_m or 0.0) if common else 0.0)
            layers.append(Layer(uav.name, home.position, altitude_m, level_m, uav.explore))
    return tuple(layers)


def variants(draft: MissionDocument) -> list[MissionDocument]:
    """The draft (with a home) as each of its UAVs flies it; the requested one first."""
    layers = layers_of(draft)
    uavs = tuple(
        replace(
            uav,
            altitude_m=layer.altitude_m,
            home=uav.home or draft.home,
            home_altitude_amsl_m=_height_m(draft, uav),
        )
        for uav, layer in zip(draft.uavs, layers, strict=True)
    )
    made = [
        replace(
            draft,
            uav=uav.name,
            uavs=uavs,
            home=uav.home,
            home_altitude_amsl_m=uav.home_altitude_amsl_m,
            altitude_m=layer.altitude_m,
            explore=uav.explore,
            climb_corridors=_climb_corridors(draft, layers, layer),
            # Two that return by themselves must not meet on one of them.
            rally_points=draft.rally_points if len(layers) == 1 else [],
        )
        for uav, layer in zip(uavs, layers, strict=True)
    ]
    return sorted(made, key=lambda variant: variant.uav != draft.uav)


def check_fleet(draft: MissionDocument) -> None:
    """Note UAVs whose layers or homes are too close, and what they cannot have of their own."""
    if len(draft.uavs) < 2:
        return
    planner = draft.planner
    distance_m = planner.clearance_m + TrackingMargin.of(planner, draft.speed_m_s).planned_m
    levels = list(zip(draft.uavs, layers_of(draft), strict=True))
    homes_m = max(planner.home_separation_m, column_radius_m(draft) + distance_m)
    for (_, lower), (uav, layer) in itertools.combinations(levels, 2):
        apart_m = abs(layer.level_m - lower.level_m)
        if apart_m < planner.vertical_separation_m:
            draft.report(
                uav.keys,
                f"'{layer.uav}' flies {apart_m:g} m from the layer of '{lower.uav}', "
                f"{planner.vertical_separation_m:g} m are to lie between two "
                "(planner.vertical_separation_m); give them other altitudes",
                "layers-too-close",
            )
        apart_m = math.dist(layer.home, lower.home)
        if apart_m < homes_m:
            draft.report(
                uav.keys if uav.home is None else uav.home.keys,
                f"the homes of '{lower.uav}' and '{layer.uav}' are {apart_m:.1f} m apart, it takes "
                f"{homes_m:g} m (planner.home_separation_m, the clearance and the tracking "
                "margin); give each a home of its own",
                "homes-too-close",
            )
    if draft.altitudes_m:
        message = "several UAVs fly here, each in its own layer; remove 'altitudes_m'"
        draft.report(("altitudes_m",), message, "altitude-in-layers")
    for spot in draft.waypoints:
        if spot.altitude_m is not None:
            message = (
                f"{spot.label} has an altitude of its own, and several UAVs fly here, each in its "
                "own layer; remove it"
            )
            draft.report(spot.keys, message, "altitude-in-layers")
    if draft.rally_points:
        message = "rally points are not put on board: two UAVs could return to the same one"
        draft.note(("rally_points",), message, "rally-points-shared")


def column_radius_m(draft: MissionDocument) -> float:
    """How far from a home its climb corridor reaches."""
    return draft.planner.home_separation_m / 2


def merge(draft: MissionDocument, made: Iterable[MissionDocument]) -> None:
    """Note problems of its variants in a draft; those of some variants name these."""
    made = list(made)
    draft.problems += _merged(made, [variant.problems for variant in made], draft.problems)
    draft.notes += _merged(made, [variant.notes for variant in made], draft.notes)


def _merged(
    made: Sequence[MissionDocument], lists: Sequence[Sequence[Problem]], known: Sequence[Problem]
) -> list[Problem]:
    merged = []
    for problem in dict.fromkeys(itertools.chain.from_iterable(lists)):
        if problem in known:
            continue
        whose = [v.uav for v, found in zip(made, lists, strict=True) if problem in found]
        suffix = "" if len(whose) == len(made) else f" (for {' and '.join(map(str, whose))})"
        merged.append(replace(problem, message=problem.message + suffix))
    return merged


def _climb_corridors(draft: MissionDocument, layers: Sequence[Layer], own: Layer) -> list[Area]:
    """What a UAV keeps away from: where those that fly higher come through its layer."""
    return [
        Area(f"home of {uav.name}", Circle(layer.home, column_radius_m(draft)), uav.keys)
        for uav, layer in zip(draft.uavs, layers, strict=True)
        if layer.level_m > own.level_m
    ]


def _height_m(draft: MissionDocument, uav: Uav) -> float | None:
    """Of the ground at a UAV's home, above the sea; that of the mission's home for want of it."""
    own_m = uav.home_altitude_amsl_m
    return draft.home_altitude_amsl_m if own_m is None else own_m
