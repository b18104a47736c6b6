"""Numbers that tune this room: each with its unit, and why it is what it is."""

from typing import Final

# For pose_check.py

FASTEST_M_S: Final = 5.0
"""No ground robot of a team drives faster; neither team file nor mission file has a limit. Research
rovers drive at 1 to 3 m/s (Clearpath Husky 1, Jackal 2, Warthog 5)."""

NOISE_M: Final = 8.0
"""So far a position may be off by itself: what is nearer than `FOLLOW_M` moves nothing anyhow."""

STAYS_S: Final = 5.0
"""A place that was jumped to is believed after so long, on the robot's clock and on ours; after
each further jump it takes twice as long."""

LONGEST_S: Final = 80.0
"""It never takes longer: a robot whose localisation was set right by hand is found again."""

MOVES_S: Final = 2.0
"""What peers send moves the vehicle at most once in this time: the fastest robot drives 10 m in it,
about what is flown after one (`FOLLOW_M`), and a vehicle of 5 m/s needs it to turn."""

YIELDS_S: Final = 20.0
"""A robot is left to another UAV at most once in this time: no search with its exchange of data is
shorter."""

# For seeking.py

MEETING_M: Final = 1.0
"""How exactly a meeting point is found along a robot's path."""

EARLY_SHARE: Final = 0.2
"""A robot may come so much of its way's time sooner than its path and speed say."""

# For target_list.py

RECENT_POSE_S = 60.0
"""A pose younger than this says where the robot is; an older one, only where it was."""

LOST_AFTER_S = 1200.0
"""A robot not heard of for so long counts as lost and is skipped while others are not."""

SOUGHT_BY_OTHER_S = 180.0
"""What another UAV said of whom it seeks holds for so long: a search takes less, mostly."""

USUAL_SPEED_M_S: Final = 1.0
"""Of a ground robot, where no robot's speed is known."""

STRETCH_S: Final = (5.0, 120.0)
"""Speed is measured between poses so far apart: noise counts in shorter, corners in longer."""

STRETCHES: Final = 12

LEFT_M: Final = 15.0
LEFT_S: Final = 60.0
"""A pose so far off a path, and so much younger, says that the robot does not follow it."""

SET_BACK: Final = 3
"""So many stamps in a row that keep step with our clock say what a robot's clock shows now."""

BEFORE_S: Final = 30.0
"""A pose so much older than a path does not say where on it the robot is."""

# For link_log.py

LINK_INTERVAL_S: Final = 2.0
"""Links are sampled so often: a vehicle of 5 m/s flies 10 m in it, over which a link lasts."""

LINK_POSE_S: Final = 30.0
"""A pose not older than this says where a robot is: it is off its path by less than `NOISE_M`."""

MOST_LINK_SAMPLES: Final = 2000
"""So many of the latest are kept: more than an hour of one robot, and evaluated in milliseconds."""

# For tour.py

MOST_STOPS: Final = 3
"""A search goes over so many robots at most: what it believes of later ones is too old by then."""

VAIN_SHARE: Final = 0.25
"""What remains of the chance to find a robot after a search in vain, until there is news of it."""

SPREAD: Final = (0.7, 1.2)
"""A robot has driven between so much and so much of what its speed says."""

OFF_WAY_M: Final = 3.0
"""Over a stretch of a robot's path the vehicle leaves out bends smaller than this."""
