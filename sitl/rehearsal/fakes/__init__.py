"""Test doubles of clocks, radios and libraries for flights of the real program."""

from sitl.rehearsal.fakes.link import Burst, Link, StreamFault, Way, wrong_of
from sitl.rehearsal.fakes.mavsdk import Fields, Send, StandIn
from sitl.rehearsal.fakes.stations import Station, Stations, foreign_messages, intrusion
from sitl.rehearsal.fakes.team import CarriedMessage, NodeStandIn, Robots, anywhere, pose, prank_of

__all__ = [
    "Burst",
    "CarriedMessage",
    "Fields",
    "Link",
    "NodeStandIn",
    "Robots",
    "Send",
    "StandIn",
    "Station",
    "Stations",
    "StreamFault",
    "Way",
    "anywhere",
    "foreign_messages",
    "intrusion",
    "pose",
    "prank_of",
    "wrong_of",
]
