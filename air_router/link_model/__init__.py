"""How probable a link is, by what the vehicle has mapped and measured; a seek policy that uses it.

A package of its own would have the same: it uses what `air_router.seek_policies` has, and the
policy is registered as an entry point like a stranger's.
"""

from air_router.link_model.link_model import (
    DISTANCE,
    MODELS,
    PATH_LOSS,
    SEMANTIC,
    LinkModel,
    ModelKind,
    fitted,
)
from air_router.link_model.link_tour import LinkTour, LinkTourByPathLoss

__all__ = [
    "DISTANCE",
    "MODELS",
    "PATH_LOSS",
    "SEMANTIC",
    "LinkModel",
    "LinkTour",
    "LinkTourByPathLoss",
    "ModelKind",
    "fitted",
]
