"""The UDP path, pure: packets, pacing, what has arrived."""

from mocha_link.datagram.datagram import Flow

__all__ = [
    "Flow",
]
