"""The complete status of a flight: the controller's, with the links measured by the node."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping

from air_router.controller import Controller, FlightStatus
from air_router.flight.limits import LINKS_REFRESH_S
from mocha_link.links import LinkMetrics


class StatusSource:
    """Makes a `FlightStatus` whenever one is read.

    Args:
        controller: Returns the status without links.
        links: Measures the links to all peers.
        now_s: The vehicle's clock.
    """

    def __init__(
        self,
        controller: Controller,
        links: Callable[[], Mapping[str, LinkMetrics]],
        now_s: Callable[[], float],
    ) -> None:
        self._controller, self._measure, self._now_s = controller, links, now_s
        self._links: Mapping[str, LinkMetrics] = {}  # last measured
        self._measured_s = -math.inf  # when

    def status(self) -> FlightStatus:
        """The current status; its links were measured at most `LINKS_REFRESH_S` ago."""
        now_s = self._now_s()
        if not 0.0 <= now_s - self._measured_s < LINKS_REFRESH_S:  # or the vehicle has restarted
            self._links, self._measured_s = self._measure(), now_s
        return dataclasses.replace(self._controller.status(), links=self._links)
