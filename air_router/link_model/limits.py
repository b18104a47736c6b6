"""Numbers that tune this room: each with its unit, and why it is what it is."""

from typing import Final

# For link_model.py

LAYERS_M: Final = ((0.5, 7.0), (7.0, 16.0))
"""Heights between which a line may cross something: one storey or two with low trees, then roofs
and crowns. Antennas of ground robots are at the lower end."""

STEPS: Final = 16
"""A line is sampled so often in each layer: of 60 m height and 200 m distance every 2 m."""

BUILDING_M: Final = 8.0
VEGETATION_M: Final = 20.0
"""After so many metres of a class a further one counts less: e times less."""

SAMPLE_WEIGHT: Final = 0.1
"""A sample of a link counts a tenth of an independent one: a link lasts for some 20 s, and is
sampled every `LINK_INTERVAL_S`."""

LEAST_UP_M: Final = 1.0
"""A vehicle on the ground is taken to be so high."""

MOST_STEPS: Final = 25
"""Newton's method ends after so many steps at the latest: five are usual."""

# For link_tour.py

FRESH_S: Final = 20.0
"""A robot whose pose is not older is hovered by, and not searched."""

AROUND: Final = 8
ASIDE_M: Final = (15.0, 30.0, 50.0)
"""It is hovered in one of so many directions from a robot, and so far aside."""

GOOD_SHARE: Final = 0.97
"""A link is about as good as from above the robot if it has so much of that probability."""
