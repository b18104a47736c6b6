"""Which robot to seek next, and where it is and will be."""

from air_router.controller.targets.limits import MOVES_S, SOUGHT_BY_OTHER_S, YIELDS_S
from air_router.controller.targets.link_log import LinkLog, LinkSample
from air_router.controller.targets.policies import SeekPolicyError, policy_of
from air_router.controller.targets.pose_check import PeerRate, PoseVerdict
from air_router.controller.targets.predicted_path import PredictedPath
from air_router.controller.targets.seeking import Freshest, Policy, Rendezvous, SeekContext, meet
from air_router.controller.targets.target_list import SearchPlace, Sighting, TargetList, TargetTrack
from air_router.controller.targets.tour import Tour, TourStop, rate

__all__ = [
    "MOVES_S",
    "SOUGHT_BY_OTHER_S",
    "YIELDS_S",
    "Freshest",
    "LinkLog",
    "LinkSample",
    "PeerRate",
    "Policy",
    "PoseVerdict",
    "PredictedPath",
    "Rendezvous",
    "SearchPlace",
    "SeekContext",
    "SeekPolicyError",
    "Sighting",
    "TargetList",
    "TargetTrack",
    "Tour",
    "TourStop",
    "meet",
    "policy_of",
    "rate",
]
