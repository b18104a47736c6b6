"""The node: its gossip core (pure), its thread, sockets and connections."""

from mocha_link.lazy import door

__getattr__, __dir__, __all__ = door(
    __name__,
    {
        "curve": ("CurveServer",),
        "gossip": ("Gossip", "TIMEOUT_S"),
        "kernel": ("Poller",),
        "node": ("Node", "NodeClosedError"),
        "router": ("ClientConnections", "IDLE_MS", "Router"),
        "transport": ("Transport",),
        "zmtp": ("Mechanism", "Null", "Part", "ZmtpSession"),
    },
    modules=("kernel",),
)
