"""Gossip node for robots whose links come and go. Usable alone: imports nothing of ours.

team = Team.load(Path("team.yaml"))
with Node(team, "titan") as node:
    node.subscribe(print)
    node.publish("/pose", b"...")
"""

import logging

from mocha_link.lazy import door

__version__ = "0.2.0"

logging.getLogger(__name__).addHandler(logging.NullHandler())  # the program decides

__getattr__, __dir__, __all__ = door(
    __name__,
    {
        "clock": ("Clock", "Instant", "SystemClock"),
        "errors": ("ListenError", "MochaLinkError", "PortInUseError", "RadioError"),
        "forks": ("ForkedError",),
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
        "links.reading": ("Reading", "Unit"),
        "node.broadcast": ("EventStream",),
        "node.node": ("Node", "NodeClosedError"),
        "radios": ("ManualRadio", "Radio", "Report", "UdpRadio", "open_radio"),
        "ros.typed": ("Typed", "TypedError"),
        "service.prometheus": ("PrometheusError", "PrometheusServer"),
        "service.server": ("MetricsServer",),
        "service.service_client": (
            "MetricsError",
            "ServiceClient",
            "ServiceError",
            "ServiceUnreachableError",
        ),
        "store.message": ("Message",),
        "store.wire": ("Header", "HeaderError", "PayloadError"),
        "team.document": ("Document", "DocumentError", "Problem"),
        "team.keys": ("KeyFileError", "KeyMismatchError", "KeysUnavailableError"),
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
    },
)
