"""Wind: it pushes, the vehicle's controller makes up for what is steady, gusts move it."""

import math

import pytest

from sitl.cli.vehicle_command import _wind
from sitl.mavlink.vehicle import STEP_S, MavlinkVehicle, VehicleSettings
from sitl.px4sim.motion.disturbances import Wind, WindSettings
from sitl.px4sim.state import FlightMode, StartPosition

HOME = StartPosition(47.397742, 8.545594, 489.4)


def blow(settings, seconds=60.0, seed=1):
    wind = Wind(settings, seed)
    return wind, [
        wind.step(STEP_S, (0.0, 0.0), flying=True) for _ in range(round(seconds / STEP_S))
    ]


def test_in_still_air_only_what_moves_is_held_back():
    _, pushes = blow(WindSettings())
    assert set(pushes) == {(0.0, 0.0)}
    drag_m_s2 = Wind(WindSettings(), 1).step(STEP_S, (5.0, 0.0), flying=True)[0]
    assert -3.0 < drag_m_s2 < -2.5


def test_it_comes_from_where_it_is_set_to():
    wind, pushes = blow(WindSettings(8.0, 270.0, 0.0))
    assert (wind.north_m_s, wind.east_m_s) == pytest.approx((0.0, 8.0))
    assert pushes[0][1] > 1.0  # it sets in at once
    assert math.hypot(*pushes[-1]) < 0.01  # and is made up for


def test_gusts_go_on_and_are_the_same_every_time():
    _, first = blow(WindSettings(5.0, 0.0, 3.0))
    _, again = blow(WindSettings(5.0, 0.0, 3.0))
    _, other = blow(WindSettings(5.0, 0.0, 3.0), seed=2)
    assert first == again != other
    assert max(abs(push[0]) for push in first[500:]) > 0.3


def test_on_the_ground_nothing_moves():
    wind = Wind(WindSettings(10.0, 0.0, 5.0), 1)
    assert wind.step(STEP_S, (0.0, 0.0), flying=False) == (0.0, 0.0)


@pytest.mark.parametrize(("gusts", "least_m", "most_m"), [(0.0, 0.0, 1.0), (6.0, 0.5, 6.0)])
def test_a_hovering_vehicle_is_moved_by_gusts_only(gusts, least_m, most_m):
    quiet = {"ground_link": False, "truth_link": False, "onboard_rates_hz": {}}
    settings = VehicleSettings(HOME, wind=WindSettings(8.0, 90.0, gusts), step_s=0.04, **quiet)
    vehicle = MavlinkVehicle(settings)
    autopilot = vehicle.autopilot
    while not autopilot.can_arm:
        vehicle.step()
    autopilot.modes.takeoff.request(HOME.altitude_m + 15)
    autopilot.request_mode(FlightMode.AUTO_TAKEOFF)
    assert autopilot.arm()
    away_m = []
    for step in range(round(60 / 0.04)):
        vehicle.step()
        if step * 0.04 > 25:
            away_m.append(math.hypot(autopilot.airframe.north_m, autopilot.airframe.east_m))
    assert least_m <= max(away_m) <= most_m


@pytest.mark.parametrize("text", ["5", "x,1", "-1,0", "5,0,1,2", "99,0", "5,0,-3", "nan,0"])
def test_what_is_no_wind(text):
    with pytest.raises(ValueError, match=r"is not|winds go"):
        _wind(text)


def test_what_is_one():
    assert _wind("5,270") == WindSettings(5.0, 270.0)
    assert _wind("5,270,2") == WindSettings(5.0, 270.0, 2.0)
