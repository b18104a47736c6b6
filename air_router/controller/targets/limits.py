"""Numbers that tune this room: each with its unit, and why it is what it is."""

from typing import Final

# For pose_check.py

FASTEST_M_S: Final = 5.0
"""Highest assumed speed of a ground robot; neither team file nor mission file has a limit. Research
rovers drive at 1 to 3 m/s (Clearpath Husky 1, Jackal 2, Warthog 5)."""

NOISE_M: Final = 8.0
"""Noise of a robot's position; below `FOLLOW_M` it moves nothing anyhow."""

STAYS_S: Final = 5.0
"""A position after a jump counts once the robot stayed there this long, by its clock and by ours;
twice as long after each further jump."""

LONGEST_S: Final = 80.0
"""Longest such wait, so a robot whose localization was corrected by hand is found again."""

MOVES_S: Final = 2.0
"""Peers' messages redirect the vehicle at most once in this time. The fastest robot drives 10 m in
it, about `FOLLOW_M`, and a vehicle at 5 m/s needs it to turn."""

YIELDS_S: Final = 20.0
"""A robot is left to another UAV at most once in this time: no search with its data exchange is
shorter."""

# For seeking.py

MEETING_M: Final = 1.0
"""Resolution of a meeting point along a robot's path."""

EARLY_SHARE: Final = 0.2
"""A robot may arrive earlier than predicted by this share of its driving time."""

# For target_list.py

RECENT_POSE_S = 60.0
"""A pose younger than this shows where the robot is; an older one, where it was."""

LOST_AFTER_S = 1200.0
"""A robot not received for this long counts as lost, and is sought after the others."""

SOUGHT_BY_OTHER_S = 180.0
"""Another UAV's published search counts for this long; most searches are shorter."""

USUAL_SPEED_M_S: Final = 1.0
"""Assumed speed of a ground robot while no robot's speed is known."""

STRETCH_S: Final = (5.0, 120.0)
"""Speed is measured between poses this far apart: shorter intervals measure noise, longer ones cut
corners."""

STRETCHES: Final = 12

LEFT_M: Final = 15.0
LEFT_S: Final = 60.0
"""A pose this far off a path, and this much younger, shows that the robot has left it."""

SET_BACK: Final = 3
"""After this many consecutive stamps in step with our clock, a robot's clock was set back."""

BEFORE_S: Final = 30.0
"""A pose older than the path by this does not show the robot's position on it."""

# For link_log.py

LINK_INTERVAL_S: Final = 2.0
"""Links are sampled so often: a vehicle of 5 m/s flies 10 m in it, over which a link lasts."""

LINK_POSE_S: Final = 30.0
"""A pose not older than this counts as current: it is off the path by less than `NOISE_M`."""

MOST_LINK_SAMPLES: Final = 2000
"""So many of the latest are kept: more than an hour of one robot, and evaluated in milliseconds."""

# For tour.py

MOST_STOPS: Final = 3
"""Most robots in one search: data about further ones would be too old by then."""

VAIN_SHARE: Final = 0.25
"""An unsuccessful search reduces the chance to find a robot to this share."""

SPREAD: Final = (0.7, 1.2)
"""Range of the distance driven by a robot, relative to its predicted distance."""

OFF_WAY_M: Final = 3.0
"""The vehicle ignores smaller bends of a robot's path."""
