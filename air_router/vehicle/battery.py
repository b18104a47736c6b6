"""Whether a battery report is believed: one message with 0 % ends no mission.

Pure. A charge that falls as batteries do is believed at once. One that jumps is believed once it
has said so for some seconds, or where the voltage has jumped with it.
"""

import math
from dataclasses import dataclass

from air_router.vehicle.limits import CHARGE_BELIEVED_S, CHARGE_JUMP, VOLTAGE_DROP
from air_router.vehicle.vehicle import Telemetry


@dataclass(slots=True, eq=False)
class BatteryWatch:
    """Takes the charge of every telemetry update in.

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
