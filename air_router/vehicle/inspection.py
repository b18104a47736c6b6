"""What a vehicle on the ground says of itself when it is asked: the facts of a pre-flight check."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

NO_FIX = 1
FIX_2D, FIX_3D = 2, 3


@dataclass(frozen=True, slots=True)
class GpsFix:
    """What the satellite receiver reports.

    Attributes:
        kind: GPS_FIX_TYPE: 0 and 1 none, 2 without altitude, 3 full, above that corrected.
        satellites: In use; None when unknown.
        accuracy_m: Horizontal, as the receiver estimates it; None when unknown.
    """

    kind: int
    satellites: int | None = None
    accuracy_m: float | None = None

    @property
    def good(self) -> bool:
        """Whether it is a position in three dimensions."""
        return self.kind >= FIX_3D


@dataclass(frozen=True, slots=True)
class Inspection:
    """What was found.

    Attributes:
        healthy: The autopilot's own health and arming checks pass.
        problems: What they find, in words; empty also where the autopilot does not say.
        warnings: What they find that does not keep it from arming.
        gps: The receiver; None when it says nothing.
        battery: Remaining charge from 0 to 1, None when unknown.
        voltage_v: Of the battery, None when unknown.
        wind_m_s: How the air moves (east, north); None when unknown.
        unix_s: The vehicle's own clock, None until it knows the time.
        parameters: By name; None for one that the vehicle does not have (or does not tell).
    """

    healthy: bool = True
    problems: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    gps: GpsFix | None = None
    battery: float | None = None
    voltage_v: float | None = None
    wind_m_s: tuple[float, float] | None = None
    unix_s: float | None = None
    parameters: Mapping[str, float | None] = field(default_factory=lambda: MappingProxyType({}))
