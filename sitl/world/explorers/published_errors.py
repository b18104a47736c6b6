"""Errors of perception and of localisation as others have measured them: a second reading.

The paper gives none of its own. Each run draws both from ranges whose ends are published results:

* `RECALL`: of cars in images from UAVs Faster R-CNN found 79.40 %, YOLOv3 99.07 % (B. Benjdira and
  others, "Car Detection using Unmanned Aerial Vehicles: Comparison between Faster R-CNN and
  YOLOv3", arXiv:1812.10968; figures as a summary of the paper gives them). That is of single
  images; here it is the share of vehicles that maps ever show. So it is a pessimistic reading, as
  a UAV sees most vehicles more than once.
* `LOCALISATION_M`: mean error of a ground robot in a map from above. 0.94 m with cameras and lidar
  in aerial images, on KITTI-360 (F. Fervers and others, "Continuous Self-Localization on Aerial
  Images Using Visual and Lidar Sensors", 2022); 10 m is the bound that authors of the paper's
  robots state ("better than 10 meter": I. D. Miller and others, "Any Way You Look At It: Semantic
  Crossview Localization and Mapping with LiDAR", arXiv:2203.08925).

Left out: vehicles that maps show where there are none, and that robots drive by wrong positions.
"""

import random
from typing import Final

from sitl.world.explorers.settings import ExplorerSettings

RECALL: Final = (0.7940, 0.9907)

LOCALISATION_M: Final = (0.94, 10.0)


def with_published_errors(settings: ExplorerSettings, seed: int) -> ExplorerSettings:
    """The settings of a run, with the errors that its seed draws if they select published ones."""
    if settings.errors == "given":
        return settings
    chance = random.Random(f"{seed} published errors")  # noqa: S311 - repeatable on purpose
    drawn = {"recall": chance.uniform(*RECALL), "localisation_m": chance.uniform(*LOCALISATION_M)}
    return settings.model_copy(update=drawn)
