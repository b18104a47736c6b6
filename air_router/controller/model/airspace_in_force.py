"""The zones and fences that count now, and how far a change of them is: a part of the context."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from enum import Enum

from air_router.mission import Mission
from air_router.routing import Router


class ZoneChange(Enum):
    """How far a change of zones is."""

    CLEARING = "the vehicle stops where it may not go on any more"
    LEAVING = "the vehicle flies out of what was drawn over it"
    UPLOADING = "the new fence is being put on board"


@dataclass(slots=True, eq=False)
class AirspaceInForce:
    """State only; `AirspaceUpdate` decides what follows from it. Only its methods change it.

    Attributes:
        mission: With the zones and fences of now.
        router: Plans among these.
        way_out_router: Plans the way out of a zone among what applies from the vehicle's height to
            the cruise altitudes; None: `router` does.
        change: How far a change of zones is; None: none is under way.
        must_stop: Zones change, and the hold for that is not confirmed yet.
        exempt_zones: The zones that it is no breach to be in: they were drawn over the vehicle.
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
        """By what the leg under way, and the next one, are planned and checked."""
        way_out = self.way_out_router if self.change is ZoneChange.LEAVING else None
        return self.router if way_out is None else way_out

    def replace(self, mission: Mission, router: Router) -> None:
        """Other zones count from now on; what is not clear any more is cleared first."""
        self.mission, self.router = mission, router
        self.revision += 1
        self.clear()

    def clear(self) -> None:
        """The vehicle stops where it may not go on, and leaves what it is in, before an upload."""
        self.change, self.way_out_router = ZoneChange.CLEARING, None

    def stop_first(self) -> None:
        """Nothing goes on before the vehicle has confirmed a hold."""
        self.must_stop = True

    def exempt(self, names: Collection[str]) -> None:
        """To be in these zones is no breach until the change is over."""
        self.exempt_zones |= frozenset(names)

    def leave(self, router: Router | None) -> None:
        """The vehicle flies out of what was drawn over it, by this router's way."""
        self.change, self.way_out_router, self.must_stop = ZoneChange.LEAVING, router, False

    def upload(self) -> None:
        """The new fence is put on board."""
        self.change = ZoneChange.UPLOADING

    def finish_change(self) -> None:
        """The change is over."""
        self.change, self.must_stop, self.exempt_zones = None, False, frozenset()
