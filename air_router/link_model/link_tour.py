"""A seek policy that predicts links by the model, and hovers where the most links are predicted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from air_router.link_model.limits import AROUND, ASIDE_M, FRESH_S, GOOD_SHARE
from air_router.link_model.link_model import PATH_LOSS, SEMANTIC, LinkModel, ModelKind, fitted
from air_router.seek_policies import SearchPlace, SeekContext, TargetList, Tour, TourStop
from geo.frame import Point

Numbers = npt.NDArray[np.float64]


class LinkTour(Tour):
    """`Tour`, which prefers robots that it will probably receive, and hovers among robots.

    Whom to seek: the gain of each robot is multiplied by the probability of a link with it from
    above where it may be.

    Where to hover while data are exchanged: among places around the robot from which the link with
    it is about as good as from above it, the one with the most links predicted to the team.

    Both use the model that is fitted to this flight's map and measured links.
    """

    kind: ModelKind = SEMANTIC
    hovers = True

    def place(self, robot: str, targets: TargetList, context: SeekContext) -> SearchPlace:
        """As `Policy.place`; of a robot whose radio is received, where to hover."""
        track = targets.tracks[robot]
        pose = track.pose
        if pose is None or context.now_s - track.ours_s(pose.stamp_s) > FRESH_S:
            return super().place(robot, targets, context)
        spots = [pose.position]
        for other in targets.names:
            course = None if other == robot else targets.course(other)
            if course is not None:
                spots.append(course.place(course.along_m(context.now_s)))
        places = [pose.position, *_around(pose.position)]
        linked = _linked(self._model(context), places, spots, context)
        good = linked[:, 0] >= GOOD_SHARE * linked[0, 0]
        best = int(np.argmax(np.where(good, linked.sum(axis=1), -1.0)))
        reason = f"where {linked[best].sum():.1f} robots are expected to be received"
        return SearchPlace(robot, places[best], reason)

    def _model(self, context: SeekContext) -> LinkModel:
        return fitted(self.kind, context.links, context.ground)

    def _stops(self, targets: TargetList, context: SeekContext) -> list[TourStop]:
        """As of `Tour`, by links."""
        model = self._model(context)
        return [
            replace(stop, gain_s=stop.gain_s * _link_above(model, stop.places, context))
            for stop in super()._stops(targets, context)
        ]


class LinkTourByPathLoss(LinkTour):
    """The same without the map: links by distance alone. The difference is the map's worth."""

    kind: ModelKind = PATH_LOSS


def _link_above(model: LinkModel, places: Sequence[Point], context: SeekContext) -> float:
    """The mean probability of a link with a robot from above where it may be."""
    air = np.column_stack([np.array(places), np.full(len(places), context.altitude_m)])
    return float(model.probability(air, np.array(places)).mean())


def _around(place: Point) -> list[Point]:
    """Places around another, where the vehicle could hover."""
    angles = [math.tau * number / AROUND for number in range(AROUND)]
    return [
        Point(place[0] + away_m * math.sin(angle), place[1] + away_m * math.cos(angle))
        for away_m in ASIDE_M
        for angle in angles
    ]


def _linked(
    model: LinkModel, places: Sequence[Point], spots: Sequence[Point], context: SeekContext
) -> Numbers:
    """[place, spot]: how probable links are between places in the air and spots on the ground."""
    air = np.column_stack([np.array(places), np.full(len(places), context.altitude_m)])
    pairs = model.probability(
        np.repeat(air, len(spots), axis=0), np.tile(np.array(spots), (len(places), 1))
    )
    found: Numbers = pairs.reshape(len(places), len(spots))
    return found
