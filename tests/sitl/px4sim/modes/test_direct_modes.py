"""What the conversations leave out of Offboard, the stick modes and Orbit."""

import math
import types

import pytest

from sitl.mavlink.setpoint_messages import local_setpoint, sticks
from sitl.px4sim.modes.direct_modes import shaped
from sitl.px4sim.motion.guidance import Direct, MaxSpeeds, direct_velocity
from sitl.px4sim.state.px4_modes import FlightMode


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


class TestSetpoints:
    def test_one_axis_alone_keeps_the_other(self, rig):
        situation = rig.autopilot.situation
        situation.east_m = 7.0
        direct = local_setpoint(message(coordinate_frame=1, type_mask=0x0FFE, x=3.0), situation)
        assert direct.position == (3.0, 7.0)
        assert direct.altitude_m is None


class TestFlown:
    @pytest.mark.parametrize("mode", ["STABILIZED", "MANUAL", "ACRO"])
    def test_modes_without_height_hold(self, rig, mode):
        rig.fly()

        def fly_by_sticks(seconds, **axes):
            for _ in range(round(seconds * 10)):
                rig.send(
                    "manual_control", 1, *({"x": 0, "y": 0, "z": 500, "r": 0} | axes).values(), 0
                )
                rig.run(0.1)

        fly_by_sticks(0.5)
        main, sub = FlightMode[mode].value[:2]
        assert rig.command(176, 1, main, sub) == [0, 0]
        before_m = rig.position()[2]
        fly_by_sticks(3.0, z=900)
        assert rig.mode == mode
        assert rig.position()[2] > before_m + 2
        fly_by_sticks(3.0, x=800)
        assert rig.away_m(0, 0) > 5

    def test_an_orbit_is_a_circle(self, rig):
        rig.fly()
        latitude, longitude = rig.degrees(10, 0)
        assert rig.command(34, 15, 3, 0, math.nan, latitude, longitude, math.nan) == [0]
        rig.run(15)
        places = []
        for _ in range(30):
            rig.run(1)
            places.append(rig.position())
        assert all(math.dist(place[:2], (10, 0)) == pytest.approx(15, abs=3) for place in places)
        assert max(place[1] for place in places) > 8 > -8 > min(place[1] for place in places)

    def test_a_jump_of_the_estimate_moves_the_vehicle(self, rig):
        rig.fly()
        rig.autopilot.errors.jump(6.0, 0.0)
        assert rig.autopilot.errors.resets == 1
        rig.run(10)
        assert rig.position()[0] == pytest.approx(-6.0, abs=1.5)  # it believes to be back

    def test_a_pilot_that_is_there_before_all_else_has_position_mode(self, rig):
        rig.run(2)
        rig.send("manual_control", 1, 0, 0, 500, 0, 0)
        rig.run(0.1)
        assert rig.mode == "POSCTL"

    def test_setpoints_again_after_another_command_do_not_take_it_back(self, rig):
        rig.fly()

        def stream(seconds):
            for _ in range(round(seconds * 5)):
                fields = (0, 1, 1, 1, 0x0FF8, 0, 0, -15, *(0,) * 8)
                rig.send("set_position_target_local_ned", *fields)
                rig.run(0.2)

        stream(0.5)
        assert rig.command(176, 1, 6, 0) == [0, 0]
        rig.run(3)
        assert rig.mode == "AUTO_RTL"
        assert rig.command(176, 1, 4, 3) == [0, 0]
        stream(2)
        assert rig.mode == "AUTO_LOITER"
