"""Gossip node for robots whose links come and go. Usable alone: imports nothing of ours.

team = Team.load(Path("team.yaml"))
with Node(team, "titan") as node:
    node.subscribe(print)
    node.publish("/pose", b"...")
"""

from importlib import import_module

__version__ = "0.2.0.dev0"

_NAMES = {
    "clock": (
        "Clock",
        "Instant",
        "SystemClock",
    ),
    "errors": (
        "ListenError",
        "MochaLinkError",
        "PortInUseError",
        "RadioError",
    ),
    "links.metrics": (
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
    "links.reading": (
        "Reading",
        "Unit",
    ),
    "node.broadcast": ("EventStream",),
    "node.curve": ("CurveUnavailableError",),
    "node.node": (
        "Message",
        "Node",
        "NodeClosedError",
    ),
    "radios": (
        "ManualRadio",
        "Radio",
        "UdpRadio",
        "open_radio",
    ),
    "service.service_client": ("MetricsError",),
    "service.prometheus": (
        "PrometheusError",
        "PrometheusServer",
    ),
    "service.server": ("MetricsServer",),
    "store.record": (
        "Header",
        "HeaderError",
    ),
    "store.payload": ("PayloadError",),
    "team.document": (
        "Document",
        "DocumentError",
        "Problem",
    ),
    "team.keys": (
        "KeyFileError",
        "KeyMismatchError",
        "KeysUnavailableError",
    ),
    "team.team": (
        "Priority",
        "Robot",
        "Team",
        "Topic",
        "Trigger",
        "Trust",
        "UnknownRobotError",
        "UnknownTopicError",
    ),
}
"""Which module has what: it is imported when one of its names is asked for, so that a program that
needs only a part, as most commands do, does not wait for numpy, pydantic and sockets. The types
stand in `__init__.pyi`; a test holds both together.
"""

_MODULES = {name: module for module, names in _NAMES.items() for name in names}

__all__ = sorted(_MODULES)  # noqa: PLE0605 - a list, computed from one table


def __getattr__(name: str) -> object:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
    globals()[name] = found  # the next time it is there
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
