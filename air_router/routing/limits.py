"""Numbers that tune this room: each with its unit, and why it is what it is."""

from typing import Final

# For departure.py

BRAKING_M_S2: Final = 2.0
"""Assumed deceleration. PX4 brakes with MPC_ACC_HOR 3 m/s2, but its jerk limit delays that."""

STANDING_M_S: Final = 0.5
"""Slower than this counts as hovering: estimates and gusts never read exactly zero."""

LEG_ROUNDING_M: Final = 0.01
"""A leg out of the margin may come this much closer than the vehicle is now, for rounding."""

SAME_PLACE_M: Final = 0.5
"""Points closer together than this are the same; PX4 reports its position to a centimeter."""

HOVER_DRIFT_M: Final = 0.25
"""Apparent drift of a hovering vehicle: noise of its estimate."""

LEEWAY_M: Final = 1.0
"""The first meters, which may be closer than routes, extend this far beyond twice the missing
clearance: if only a centimeter is missing, the vehicle still needs room to turn."""

LEEWAY_OUT_OF_ZONE: Final = 1.5
"""A leg out of a zone may take this many times the shortest way out before it has to be clear: it
leaves at a slant, toward its destination."""

WAY_OUT_DETOUR: Final = 1.05
WAY_OUT_DETOUR_M: Final = 1.0
"""A way out of a tight place may be this much longer than the shortest one at the time of the
check: the vehicle is never exactly where the way was planned."""

# For graph.py

GRAPH_NEIGHBOURS: Final = 3
"""Number of neighbors to which each piece of the graph is joined: one alone causes detours, and
each further one costs a path search."""

# For return_planner.py

ACCELERATION_M_S2: Final = 2.0
"""Acceleration and deceleration at the ends of a leg in flight times; as `BRAKING_M_S2`."""

LANDING_M_S: Final = 0.7
"""PX4's descent speed near the ground (MPC_LAND_SPEED). PX4 descends faster above 10 m: a
margin."""

LANDING_MARGIN: Final = 0.10
"""Charge left after landing, as a share of 1. At 7 % PX4 returns on its own, in a straight line."""

WAY_HOME_MOVED_M: Final = 5.0
WAY_HOME_EVERY_S: Final = 5.0
"""The way home is replanned after this distance or time. The distance flown since then is added to
its length, so the required charge is never too low."""

RTL_RETURN_ALT_M: Final = 60.0
"""PX4's default of RTL_RETURN_ALT, above home."""

# For router.py

SAME_WAYPOINT_M: Final = 0.01
"""A free point closer to a waypoint than this is that waypoint: MAVLink rounds to a centimeter."""
