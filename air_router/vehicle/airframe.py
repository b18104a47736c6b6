"""Which vehicles are flown: by the type and the autopilot that a HEARTBEAT names. Pure.

A plan for a multicopter is none for another vehicle: a fixed wing does not hover at a node, a VTOL
may change into one on a leg, and modes of another autopilot have other numbers.
"""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Final

from air_router.vehicle.limits import (
    ANOTHER_TYPE_CLEARED,
    ANOTHER_TYPE_HEARTBEATS,
    ANOTHER_TYPE_WINDOW,
)

MULTICOPTERS: Final[Mapping[int, str]] = MappingProxyType(
    {
        2: "quadrotor",
        3: "coaxial rotor",
        13: "hexarotor",
        14: "octorotor",
        15: "tricopter",
        29: "dodecarotor",
        35: "decarotor",
    }
)
"""MAV_TYPE of the vehicles that are flown."""

VTOLS: Final = frozenset({19, 20, 21, 22, 23, 24, 25, 47})
"""MAV_TYPE_VTOL_*, all of them."""

_OTHERS: Final[Mapping[int, str]] = MappingProxyType(
    {
        0: "vehicle of no type",
        1: "fixed wing",
        4: "helicopter",
        7: "airship",
        8: "balloon",
        9: "rocket",
        10: "ground rover",
        11: "boat",
        12: "submarine",
        16: "flapping wing",
        28: "parafoil",
        43: "multirotor of no type",
    }
)
PX4: Final = 12  # MAV_AUTOPILOT
_AUTOPILOTS: Final = MappingProxyType({3: "ArduPilot", PX4: "PX4"})

SET_UP: Final = "connect a multicopter; if this is one, choose its airframe (MAV_TYPE) in PX4"
"""What to do about another vehicle."""


@dataclass(frozen=True, slots=True)
class Airframe:
    """What a vehicle reports that it is.

    Attributes:
        kind: HEARTBEAT.type, a MAV_TYPE.
        autopilot: HEARTBEAT.autopilot, a MAV_AUTOPILOT.
        vtol: EXTENDED_SYS_STATE.vtol_state is not undefined.
    """

    kind: int = 2
    autopilot: int = PX4
    vtol: bool = False

    @property
    def words(self) -> str:
        """Its type as text."""
        if self.kind in VTOLS or self.vtol:
            return "VTOL"
        other = _OTHERS.get(self.kind, f"vehicle of MAV_TYPE {self.kind}")
        return MULTICOPTERS.get(self.kind, other)

    @property
    def why_not_flown(self) -> str | None:
        """Why no mission is flown with it; None: it is a multicopter with PX4."""
        if self.autopilot != PX4:
            name = _AUTOPILOTS.get(self.autopilot, f"MAV_AUTOPILOT {self.autopilot}")
            return f"the autopilot is {name}, not PX4"
        if self.kind in MULTICOPTERS and not self.vtol:
            return None
        if self.kind in MULTICOPTERS:
            return "the vehicle is a VTOL (it reports a vtol_state); only multicopters are flown"
        return f"the vehicle is a {self.words} (MAV_TYPE {self.kind}); only multicopters are flown"


@dataclass(slots=True, eq=False)
class AirframeWatch:
    """Follows what HEARTBEATs name, so that neither a stray one counts nor two that take turns.

    Attributes:
        airframe: As it was named last; while `why_not` stands, the one that it is about.
        why_not: Why no mission is flown with what is on the link; None: nothing stands against it.
    """

    airframe: Airframe = field(default_factory=Airframe)
    why_not: str | None = None
    _vtol: bool = False  # as EXTENDED_SYS_STATE reported last
    _latest: deque[Airframe] = field(  # as named
        default_factory=lambda: deque(maxlen=ANOTHER_TYPE_CLEARED)
    )

    def state(self, fields: Mapping[str, Any]) -> None:
        """Take an EXTENDED_SYS_STATE."""
        self._vtol = bool(fields.get("vtol_state"))

    def heartbeat(self, fields: Mapping[str, Any]) -> bool:
        """Take a HEARTBEAT; whether `why_not` is another."""
        named = Airframe(fields["type"], fields["autopilot"], self._vtol)
        self._latest.append(named)
        before = self.why_not
        others = [other for other in self._latest if other.why_not_flown is not None]
        lately = sum(other in others for other in list(self._latest)[-ANOTHER_TYPE_WINDOW:])
        if lately >= ANOTHER_TYPE_HEARTBEATS:
            self.airframe = others[-1]
            self.why_not = self.airframe.why_not_flown
        elif self.why_not is None or not others:
            self.airframe, self.why_not = named, None
        return self.why_not != before
