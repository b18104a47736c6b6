"""Whether what a battery says is believed: one message with 0 % ends no mission.

Pure. A charge that falls as batteries do is believed at once. One that jumps is believed once it
has said so for some seconds, or where the voltage has jumped with it.
"""

import math
from dataclasses import dataclass
from typing import Final

from air_router.vehicle.vehicle import Telemetry

JUMP: Final = 0.05
"""A charge that changes by more than this share of a full battery from one message to the next has
jumped. At 20 minutes for a full battery, 5 % take a minute; PX4 tells the charge every second."""

BELIEVED_S: Final = 3.0
"""A charge that has jumped is believed after so long: at 5 m/s that costs 15 m of the way home."""

SAG: Final = 0.05
"""Where the voltage has fallen by this share as well, it is believed at once. A load makes a pack
sag by less for longer; a cell of four that fails takes a quarter."""


@dataclass(slots=True, eq=False)
class BatteryWatch:
    """Takes the charge of every telemetry in.

    Attributes:
        charge: As it is believed, 0 to 1; None: unknown.
        doubted: What it says instead, since its jump; None: nothing is doubted.
    """

    charge: float | None = None
    doubted: float | None = None
    _since_s: float = 0.0  # of the jump, vehicle's clock
    _voltage_v: float | None = None  # with the last charge that was believed

    def take(self, telemetry: Telemetry) -> float | None:
        """Take the next telemetry in; the charge that is believed."""
        told, now_s = telemetry.battery, telemetry.told_s
        if told is None:
            self.charge = self.doubted = None
            return None
        if self.charge is None or abs(told - self.charge) <= JUMP:
            return self._believe(telemetry, told)
        if self.doubted is None or abs(told - self.doubted) > JUMP:
            self.doubted, self._since_s = told, now_s
        self.doubted = told
        if now_s - self._since_s >= BELIEVED_S or self._sags(telemetry):
            return self._believe(telemetry, told)
        return self.charge

    def _sags(self, telemetry: Telemetry) -> bool:
        before_v, now_v = self._voltage_v, telemetry.voltage_v
        if before_v is None or now_v is None or not math.isfinite(now_v):
            return False
        return now_v <= (1.0 - SAG) * before_v

    def _believe(self, telemetry: Telemetry, told: float) -> float:
        self.charge, self.doubted, self._voltage_v = told, None, telemetry.voltage_v
        return told
