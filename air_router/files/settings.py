"""The numbers of a mission that have sensible defaults."""

from dataclasses import dataclass
from typing import Annotated, Final, Literal, get_args

from pydantic import Field

PlannerKind = Literal["waypoints", "shortest"]
"""`waypoints` stays on the operator's waypoint graph (the paper's), `shortest` goes straight."""

SeekPolicy = Literal["round_robin", "freshest", "rendezvous"]
"""How the robot that is sought next is chosen, and its place; see docs/seeking.md."""

Accepted = Literal[
    "rtl_crosses_zones", "rtl_altitude", "rtl_type", "sticks_do_not_override", "fence_action"
]
"""What a mission file may accept of a vehicle by name; without it nothing takes off like that."""

SEEK_POLICIES: Final[tuple[SeekPolicy, ...]] = get_args(SeekPolicy)
DEFAULT_SEEK_POLICY: Final[SeekPolicy] = "round_robin"


Seconds = Annotated[float, Field(gt=0, le=86_400)]
Clearance = Annotated[float, Field(ge=0, le=1_000)]
"""Limits hold for what files say; programs may go beyond."""


@dataclass(frozen=True, slots=True)
class Timers:
    """How long the mission's states last, in seconds of the vehicle's clock (defaults: paper).

    Attributes:
        init_s: first exploration, before any robot is sought (the paper's t_i).
        explore_s: exploration between two searches (t_e).
        search_s: waiting for a robot, from the arrival where it should be (t_s).
        communicate_s: the longest that the vehicle hovers over a robot (t_c).
        hold_s: hovering at the last of the points that it was sent to on request.
    """

    init_s: Seconds = 180.0
    explore_s: Seconds = 120.0
    search_s: Seconds = 45.0
    communicate_s: Seconds = 20.0
    hold_s: Seconds = 20.0


@dataclass(frozen=True, slots=True)
class PlannerSettings:
    """How routes are planned.

    Attributes:
        clearance_m: the least distance of the vehicle to zones and fence.
        tracking_margin_m: kept on top of it when planning: what wind, position noise and braking
            may take.
        max_edge_m: the longest connection between two waypoints of the graph.
        acceptance_radius_m: nearer than this to a waypoint counts as there.
        vertical_margin_m: how far the vehicle may be off the altitudes that it flies at, when zones
            are chosen by their altitude limits.
        terrain_relief_m: how much higher or lower than at home the ground may be, for zones whose
            limits count from the ground.
        vertical_separation_m: what lies between the layers of two UAVs of one mission, at least.
        home_separation_m: what lies between their homes, at least.
        kind: whether routes stay on the waypoint graph or are the shortest there are.
    """

    clearance_m: Clearance = 5.0
    tracking_margin_m: Annotated[float, Field(ge=0.02, le=1_000)] = 1.5
    max_edge_m: Annotated[float, Field(gt=0, le=10_000)] = 100.0
    acceptance_radius_m: Annotated[float, Field(ge=0.5, le=20)] = 2.0
    vertical_margin_m: Annotated[float, Field(ge=2, le=1_000)] = 5.0
    terrain_relief_m: Clearance = 20.0
    vertical_separation_m: Annotated[float, Field(ge=4, le=1_000)] = 10.0
    home_separation_m: Annotated[float, Field(ge=4, le=1_000)] = 20.0
    kind: PlannerKind = "waypoints"

    @property
    def distance_m(self) -> float:
        """What routes keep away: clearance and tracking margin."""
        return self.clearance_m + self.tracking_margin_m

    @property
    def departure_margin_m(self) -> float:
        """The margin of a leg that starts where the vehicle is, a little off the planned one."""
        return self.tracking_margin_m / 2


DEFAULT_SPEED_M_S = 3.5
SLOWEST_M_S = 1.0  # a slower one cannot be told from one that hovers
DEFAULT_BATTERY_RESERVE = 0.25
