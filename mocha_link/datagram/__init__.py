"""The UDP path, pure: packets, pacing, acknowledgements."""

from mocha_link.datagram.datagram import Flow

__all__ = [
    "Flow",
]
