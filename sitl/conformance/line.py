"""Between a conversation and a vehicle: two MAVLink links and the vehicle's own time."""

from __future__ import annotations

from enum import Enum
from typing import Protocol

from sitl.conformance.frames import Frame


class Link(Enum):
    """Which of PX4's links."""

    API = "API"
    GROUND = "GCS"


class SilentVehicleError(Exception):
    """Nothing was heard of the vehicle for too long; the message says where."""


class Line(Protocol):
    """A vehicle at the other end."""

    links: frozenset[Link]
    """The links that there are."""

    fresh: bool
    """Whether the vehicle was started for this conversation alone."""

    @property
    def now_s(self) -> float:
        """The vehicle's simulated time."""

    def send(self, link: Link, frame: bytes) -> None:
        """Say something."""

    def listen(self) -> list[tuple[Link, Frame]]:
        """Let a little of the vehicle's time pass; what was heard in it.

        Raises:
            SilentVehicleError: the vehicle says nothing any more.
        """

    def close(self) -> None:
        """Let go of it."""
