"""Gossip node for robots whose links come and go. Usable alone: imports nothing of ours.

team = Team.load(Path("team.yaml"))
with Node(team, "titan") as node:
    node.subscribe(print)
    node.publish("/pose", b"...")
"""

from mocha_link.broadcast import EventStream
from mocha_link.clock import Clock, Instant, SystemClock
from mocha_link.curve import CurveUnavailableError
from mocha_link.document import Document, DocumentError, Problem
from mocha_link.errors import MochaLinkError
from mocha_link.header import Header, HeaderError
from mocha_link.keys import KeyFileError, KeyMismatchError, KeysUnavailableError
from mocha_link.metrics import (
    Contact,
    ContactBegan,
    ContactEnded,
    Direction,
    LinkEvent,
    LinkMetrics,
    LinkState,
    MessageStored,
    RssiChanged,
    StorageFailed,
    StorageRecovered,
    SyncEnded,
    SyncStarted,
    SyncTimedOut,
)
from mocha_link.node import Message, Node, NodeClosedError
from mocha_link.payload import PayloadError
from mocha_link.port import ListenError, PortInUseError
from mocha_link.prometheus import PrometheusError, PrometheusServer
from mocha_link.radios import ManualRadio, Radio, RadioError, UdpRadio, open_radio
from mocha_link.reading import Reading, Unit
from mocha_link.team import (
    Priority,
    Robot,
    Team,
    Topic,
    Trigger,
    Trust,
    UnknownRobotError,
    UnknownTopicError,
)
from mocha_link.telemetry import MetricsError, MetricsServer

__all__ = [
    "Clock",
    "Contact",
    "ContactBegan",
    "ContactEnded",
    "CurveUnavailableError",
    "Direction",
    "Document",
    "DocumentError",
    "EventStream",
    "Header",
    "HeaderError",
    "Instant",
    "KeyFileError",
    "KeyMismatchError",
    "KeysUnavailableError",
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
    "PrometheusError",
    "PrometheusServer",
    "Radio",
    "RadioError",
    "Reading",
    "Robot",
    "RssiChanged",
    "StorageFailed",
    "StorageRecovered",
    "SyncEnded",
    "SyncStarted",
    "SyncTimedOut",
    "SystemClock",
    "Team",
    "Topic",
    "Trigger",
    "Trust",
    "UdpRadio",
    "Unit",
    "UnknownRobotError",
    "UnknownTopicError",
    "open_radio",
]
