"""Which vehicles are flown, by type and autopilot in HEARTBEAT. Pure.

A multicopter's plan does not fit other vehicles: a fixed wing cannot hover at a node, a VTOL may
transition on a leg, and another autopilot numbers its modes differently.
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
"""The operator's action for another vehicle."""


@dataclass(frozen=True, slots=True)
class Airframe:
    """The type of vehicle, as it reports it.

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
        """The type as text."""
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
    """Tracks the type in HEARTBEATs, robust to stray frames and to two vehicles in turns.

    Attributes:
        airframe: The last reported type; with `why_not`, the type it concerns.
        why_not: Why no mission is flown with the vehicle on the link; None: it may fly.
    """

    airframe: Airframe = field(default_factory=Airframe)
    why_not: str | None = None
    _vtol: bool = False  # by the last EXTENDED_SYS_STATE
    _latest: deque[Airframe] = field(  # latest reported types
        default_factory=lambda: deque(maxlen=ANOTHER_TYPE_CLEARED)
    )

    def state(self, fields: Mapping[str, Any]) -> None:
        """Handle an EXTENDED_SYS_STATE."""
        self._vtol = bool(fields.get("vtol_state"))

    def heartbeat(self, fields: Mapping[str, Any]) -> bool:
        """Handle a HEARTBEAT; return whether `why_not` has changed."""
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
