"""Numbers that tune this room: each with its unit, and why it is what it is."""

from typing import Final

# For departure.py

BRAKING_M_S2: Final = 2.0
"""Deceleration to count on. PX4 brakes with MPC_ACC_HOR 3 m/s2, but jerk-limited, so later."""

STANDING_M_S: Final = 0.5
"""Slower than this counts as hovering: estimates and gusts never read exactly zero."""

LEG_ROUNDING_M: Final = 0.01
"""How much closer than the vehicle is now a leg out of the margin may come: rounding."""

SAME_PLACE_M: Final = 0.5
"""Places nearer than this to each other are the same; PX4 reports its own to a centimetre."""

HOVER_DRIFT_M: Final = 0.25
"""What a hovering vehicle may seem to drift within its stopping distance, by its estimate."""

LEEWAY_M: Final = 1.0
"""The first metres, which may be closer than routes are, reach so much farther than twice
what is missing of the clearance: where that is a centimetre, there has to be room to turn too."""

LEEWAY_OUT_OF_ZONE: Final = 1.5
"""A leg out of a zone may take so many times the shortest way out before it has to be clear: it
leads out at a slant, towards where it goes."""

WAY_OUT_DETOUR: Final = 1.05
WAY_OUT_DETOUR_M: Final = 1.0
"""How much longer than the shortest a way out of a tight place may be, from where it is checked:
the vehicle is never exactly where the way was planned from."""

# For graph.py

GRAPH_NEIGHBOURS: Final = 3
"""To how many of the pieces around it a piece of the graph is joined: one alone would make detours,
and each further one is a path to find."""

# For return_planner.py

ACCELERATION_M_S2: Final = 2.0
"""What a flight time counts for speeding up and braking at the ends of a leg; as `BRAKING_M_S2`."""

LANDING_M_S: Final = 0.7
"""PX4's last metres (MPC_LAND_SPEED); it is faster above 10 m, which we leave as a margin."""

LANDING_MARGIN: Final = 0.10
"""The charge that is left on the ground, of 1. At 7 % PX4 returns by itself, straight."""

WAY_HOME_MOVED_M: Final = 5.0
WAY_HOME_EVERY_S: Final = 5.0
"""The way home is planned anew when the vehicle has moved so far, or after so long: what it has
moved since is added to the way, so that the battery's need is never too small."""

RTL_RETURN_ALT_M: Final = 60.0
"""PX4's default of RTL_RETURN_ALT, above home."""

# For router.py

SAME_WAYPOINT_M: Final = 0.01
"""A free point nearer than this to a waypoint is the waypoint: the wire rounds to a centimetre."""
