"""The zones and fences in force, and the stage of a change: one part of the context."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from enum import Enum

from air_router.mission import Mission
from air_router.routing import Router


class ZoneChange(Enum):
    """The stage of a change of zones."""

    CLEARING = "the vehicle stops if its leg is no longer clear"
    LEAVING = "the vehicle leaves a zone that was drawn over it"
    UPLOADING = "the new fence is being uploaded"


@dataclass(slots=True, eq=False)
class AirspaceInForce:
    """State only; `AirspaceUpdate` decides. Only its own methods change it.

    Attributes:
        mission: The mission with the zones and fences in force.
        router: Plans routes among them.
        way_out_router: Plans the way out of a zone, for the zones between the vehicle's altitude
            and the cruise altitudes; None: `router` does.
        change: Stage of a change of zones; None: there is none.
        must_stop: The hold for a change of zones is not confirmed yet.
        exempt_zones: Zones drawn over the vehicle: being in them is no breach.
        revision: Counts the changes of zones and fences, from 1 on.
    """

    mission: Mission
    router: Router
    way_out_router: Router | None = None
    change: ZoneChange | None = None
    must_stop: bool = False
    exempt_zones: frozenset[str] = frozenset()
    revision: int = 1

    @property
    def flown_router(self) -> Router:
        """The router that plans and checks the current and the next leg."""
        way_out = self.way_out_router if self.change is ZoneChange.LEAVING else None
        return self.router if way_out is None else way_out

    def replace(self, mission: Mission, router: Router) -> None:
        """Put other zones in force; the vehicle first stops or leaves as needed."""
        self.mission, self.router = mission, router
        self.revision += 1
        self.clear()

    def clear(self) -> None:
        """The vehicle stops if its leg is not clear, and leaves its zone, before the upload."""
        self.change, self.way_out_router = ZoneChange.CLEARING, None

    def stop_first(self) -> None:
        """The change waits until the vehicle has confirmed a hold."""
        self.must_stop = True

    def exempt(self, names: Collection[str]) -> None:
        """Being in these zones is no breach until the change is over."""
        self.exempt_zones |= frozenset(names)

    def leave(self, router: Router | None) -> None:
        """The vehicle leaves the zone drawn over it, by a route of this router."""
        self.change, self.way_out_router, self.must_stop = ZoneChange.LEAVING, router, False

    def upload(self) -> None:
        """The new fence is being uploaded."""
        self.change = ZoneChange.UPLOADING

    def finish_change(self) -> None:
        """The change is over."""
        self.change, self.must_stop, self.exempt_zones = None, False, frozenset()
