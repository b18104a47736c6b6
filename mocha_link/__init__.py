"""Gossip node for robots whose links come and go. Usable alone: imports nothing of ours.

team = Team.load(Path("team.yaml"))
with Node(team, "titan") as node:
    node.subscribe(print)
    node.publish("/pose", b"...")
"""

from mocha_link.broadcast import EventStream
from mocha_link.clock import Clock, Instant, SystemClock
from mocha_link.document import Document, DocumentError, Problem
from mocha_link.errors import MochaLinkError
from mocha_link.header import Header, HeaderError
from mocha_link.metrics import (
    Direction,
    LinkEvent,
    LinkMetrics,
    LinkState,
    MessageStored,
    RssiChanged,
    SyncEnded,
    SyncStarted,
    SyncTimedOut,
)
from mocha_link.node import Message, Node, NodeClosedError
from mocha_link.payload import PayloadError
from mocha_link.radios import ManualRadio, Radio, RadioError, UdpRadio
from mocha_link.team import (
    Priority,
    Robot,
    Team,
    Topic,
    Trigger,
    UnknownRobotError,
    UnknownTopicError,
)
from mocha_link.telemetry import MetricsError, MetricsServer
from mocha_link.transport import ListenError, PortInUseError

__all__ = [
    "Clock",
    "Direction",
    "Document",
    "DocumentError",
    "EventStream",
    "Header",
    "HeaderError",
    "Instant",
    "LinkEvent",
    "LinkMetrics",
    "LinkState",
    "ListenError",
    "ManualRadio",
    "Message",
    "MessageStored",
    "MetricsError",
    "MetricsServer",
    "MochaLinkError",
    "Node",
    "NodeClosedError",
    "PayloadError",
    "PortInUseError",
    "Priority",
    "Problem",
    "Radio",
    "RadioError",
    "Robot",
    "RssiChanged",
    "SyncEnded",
    "SyncStarted",
    "SyncTimedOut",
    "SystemClock",
    "Team",
    "Topic",
    "Trigger",
    "UdpRadio",
    "UnknownRobotError",
    "UnknownTopicError",
]
