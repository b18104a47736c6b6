"""Filters battery reports, so a single message with 0 % ends no mission.

Pure. A charge that falls at a normal rate is accepted at once. A charge that jumps is accepted
after some seconds, or if the voltage has dropped with it.
"""

import math
from dataclasses import dataclass

from air_router.vehicle.limits import CHARGE_BELIEVED_S, CHARGE_JUMP, VOLTAGE_DROP
from air_router.vehicle.vehicle import Telemetry


@dataclass(slots=True, eq=False)
class BatteryWatch:
    """Filters the charge of every telemetry update.

    Attributes:
        charge: The accepted charge, 0 to 1; None: unknown.
        doubted: The reported charge after a jump that is not accepted yet; None: there is none.
    """

    charge: float | None = None
    doubted: float | None = None
    _since_s: float = 0.0  # time of the jump, vehicle's clock
    _voltage_v: float | None = None  # at the last accepted charge

    def take(self, telemetry: Telemetry) -> float | None:
        """Handle the next telemetry; return the accepted charge."""
        reported, now_s = telemetry.battery, telemetry.received_s
        if reported is None:
            self.charge = self.doubted = None
            return None
        if self.charge is None or abs(reported - self.charge) <= CHARGE_JUMP:
            return self._believe(telemetry, reported)
        if self.doubted is None or abs(reported - self.doubted) > CHARGE_JUMP:
            self.doubted, self._since_s = reported, now_s
        self.doubted = reported
        if now_s - self._since_s >= CHARGE_BELIEVED_S or self._sags(telemetry):
            return self._believe(telemetry, reported)
        return self.charge

    def _sags(self, telemetry: Telemetry) -> bool:
        before_v, now_v = self._voltage_v, telemetry.voltage_v
        if before_v is None or now_v is None or not math.isfinite(now_v):
            return False
        return now_v <= (1.0 - VOLTAGE_DROP) * before_v

    def _believe(self, telemetry: Telemetry, reported: float) -> float:
        self.charge, self.doubted, self._voltage_v = reported, None, telemetry.voltage_v
        return reported
