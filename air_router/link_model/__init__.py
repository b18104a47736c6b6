"""Predicts links from the vehicle's map and measured links; a seek policy that uses it.

Written like an external package: it uses only `air_router.seek_policies`, and its policy is
registered by an entry point.
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
