"""Hold of the simulated autopilot: a DO_REPOSITION that no step took up is not flown to later."""

import pytest

from sitl.px4sim.auto_modes import HoldFlight
from sitl.px4sim.motion import Setpoint, SetpointKind


class Now:
    """What Hold reads of a vehicle in flight."""

    def __init__(self, time_s):
        self.time_s, self.armed, self.landed, self.speed_m_s = time_s, True, False, None
        self.heading_rad, self.acceptance_m = 0.0, 2.0
        self.setpoint = Setpoint(SetpointKind.TAKEOFF, 1.0, 2.0, 30.0)


@pytest.mark.parametrize(
    ("later_s", "goes"), [(0.1, True), (0.4, True), (0.6, False), (160.0, False)]
)
def test_an_old_reposition_is_not_flown_to_when_hold_is_entered(later_s, goes):
    hold, target = HoldFlight(), Setpoint(SetpointKind.POSITION, 70.0, 80.0, 40.0)
    hold.reposition(target, time_s=10.0)
    now = Now(10.0 + later_s)
    hold.activate(now)
    assert (hold.update(now) == target) is goes
