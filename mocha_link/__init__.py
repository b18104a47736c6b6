"""Gossip node for robots whose links come and go. Usable alone: imports nothing of ours.

team = Team.load(Path("team.yaml"))
with Node(team, "titan") as node:
    node.subscribe(print)
    node.publish("/pose", b"...")
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
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

_NAMES = {
    "broadcast": ("EventStream",),
    "clock": ("Clock", "Instant", "SystemClock"),
    "curve": ("CurveUnavailableError",),
    "document": ("Document", "DocumentError", "Problem"),
    "errors": ("MochaLinkError",),
    "header": ("Header", "HeaderError"),
    "keys": ("KeyFileError", "KeyMismatchError", "KeysUnavailableError"),
    "metrics": (
        "Contact",
        "ContactBegan",
        "ContactEnded",
        "Direction",
        "LinkEvent",
        "LinkMetrics",
        "LinkState",
        "MessageStored",
        "RssiChanged",
        "StorageFailed",
        "StorageRecovered",
        "SyncEnded",
        "SyncStarted",
        "SyncTimedOut",
    ),
    "node": ("Message", "Node", "NodeClosedError"),
    "payload": ("PayloadError",),
    "port": ("ListenError", "PortInUseError"),
    "prometheus": ("PrometheusError", "PrometheusServer"),
    "radios": ("ManualRadio", "Radio", "RadioError", "UdpRadio", "open_radio"),
    "reading": ("Reading", "Unit"),
    "team": (
        "Priority",
        "Robot",
        "Team",
        "Topic",
        "Trigger",
        "Trust",
        "UnknownRobotError",
        "UnknownTopicError",
    ),
    "telemetry": ("MetricsError", "MetricsServer"),
}
"""Which module has what: it is imported when one of its names is asked for, so that whoever needs
only a part, as most commands do, does not wait for numpy, pydantic and sockets.
"""

if not TYPE_CHECKING:  # for a type checker every name would be there, of type Any
    _MODULES = {name: module for module, names in _NAMES.items() for name in names}

    def __getattr__(name: str) -> object:
        if name not in _MODULES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        found = getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
        globals()[name] = found  # the next time it is there
        return found

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__})
