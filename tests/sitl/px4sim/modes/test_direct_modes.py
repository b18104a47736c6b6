"""What the conversations leave out of Offboard, the stick modes and Orbit."""

import math
import types

import pytest

from sitl.mavlink.setpoint_messages import local_setpoint, sticks
from sitl.px4sim.modes.direct_modes import shaped
from sitl.px4sim.motion.guidance import Direct, MaxSpeeds, direct_velocity
from tests.sitl.prepared import local_line


def message(**fields):
    names = ("x", "y", "z", "vx", "vy", "vz", "yaw", "yaw_rate", "lat_int", "lon_int", "alt", "r")
    return types.SimpleNamespace(**(dict.fromkeys(names, 0.0) | fields))


def test_a_velocity_goes_with_the_distance_up_to_the_greatest_speed():
    reach = MaxSpeeds(12.0, 3.0, 1.5)
    near = direct_velocity(Direct((2.0, 0.0), 101.0), (0.0, 0.0, 100.0), reach)
    assert (near.north_m_s, near.up_m_s) == pytest.approx((1.9, 1.0))
    far = direct_velocity(Direct((300.0, 400.0), 0.0), (0.0, 0.0, 100.0), reach)
    assert math.hypot(far.north_m_s, far.east_m_s) == pytest.approx(12.0)
    assert far.up_m_s == -1.5


def test_a_place_that_is_no_number_is_here():
    wanted = direct_velocity(Direct((math.nan, 1.0), math.nan), (5.0, 0.0, 100.0), MaxSpeeds())
    assert (wanted.north_m_s, wanted.up_m_s) == (0.0, 0.0)


def test_sticks_are_shaped_with_a_dead_zone():
    assert shaped(0.09) == shaped(-0.05) == 0.0
    assert shaped(1.0) == pytest.approx(1.0)
    assert shaped(-1.0) == pytest.approx(-1.0)
    assert 0 < shaped(0.5) < 0.5


def test_axes_out_of_range_are_in_the_middle():
    assert sticks(message(x=2000, y=-500, z=-1, r=500)).pitch == 0.0
    assert sticks(message(x=0, y=-500, z=1000, r=500)).throttle == 1.0


def test_one_axis_alone_keeps_the_other():
    situation = local_line().vehicle.autopilot.situation
    situation.east_m = 7.0
    direct = local_setpoint(message(coordinate_frame=1, type_mask=0x0FFE, x=3.0), situation)
    assert direct.position == (3.0, 7.0)
    assert direct.altitude_m is None
