"""Routes: the waypoint graph, the planners, first legs, and the ways home."""

from air_router.routing.departure import (
    Momentum,
    PendingSetpoint,
    names_of,
)
from air_router.routing.graph import WaypointGraph
from air_router.routing.limits import BRAKING_M_S2, LANDING_MARGIN, STANDING_M_S
from air_router.routing.return_planner import (
    Pace,
    ReturnPlanner,
    Way,
    WayHome,
    straight_returns,
)
from air_router.routing.router import Leg, NoRoute, Route, Router

__all__ = [
    "BRAKING_M_S2",
    "LANDING_MARGIN",
    "STANDING_M_S",
    "Leg",
    "Momentum",
    "NoRoute",
    "Pace",
    "PendingSetpoint",
    "ReturnPlanner",
    "Route",
    "Router",
    "Way",
    "WayHome",
    "WaypointGraph",
    "names_of",
    "straight_returns",
]
