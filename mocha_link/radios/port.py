"""The port that every radio serves, and the radio that says what it is told to."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from mocha_link.links.reading import Reading

Report = Callable[[str, Reading | float | None], None]
"""Takes a peer and how it is heard: a reading, a bare number in dBm, or None (not heard)."""


class Radio(Protocol):
    """Reports how peers are heard while it is started."""

    def start(self, report: Report) -> None:
        """Begin: call `report(peer, reading)`, from any thread; None: the peer is not heard.

        `report` raises UnknownRobotError for a name that is not linked to the robot, RadioError
        for a bare number that cannot be one in dBm.
        """

    def close(self) -> None:
        """Stop reporting and give up what is held; may be called twice."""


class ManualRadio:
    """A radio that says what it is told to; for embedding and tests."""

    def __init__(self) -> None:
        self._report: Report | None = None  # while it is started

    def start(self, report: Report) -> None:
        """Begin to pass reports on."""
        self._report = report

    def close(self) -> None:
        """Stop passing reports on."""
        self._report = None

    def report(self, peer: str, reading: Reading | float | None) -> None:
        """Report how a peer is heard: a reading, an RSSI in dBm, None for not at all.

        Lost while the node is not started.

        Raises:
            UnknownRobotError: the peer is not linked to the robot.
            RadioError: no number, or not within -1000 to 1000.
        """
        if self._report:
            self._report(peer, reading)
