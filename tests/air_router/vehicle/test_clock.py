import pytest

from air_router.vehicle.clock import VehicleClock
from air_router.vehicle.limits import PACE_ALLOWANCE_S


class Wall:
    def __init__(self):
        self.now_s = 100.0

    def __call__(self):
        return self.now_s


def test_before_anything_is_received_it_is_this_machine_s_time():
    clock = VehicleClock(monotonic=Wall(), unix=lambda: 5e8)
    assert clock.boot_s() == 0.0
    assert clock.now_s() == 5e8


def test_it_runs_on_at_the_vehicle_s_rate_between_two_messages():
    wall = Wall()
    clock = VehicleClock(monotonic=wall, unix=lambda: 5e8)
    for step in range(30):
        wall.now_s = 100.0 + step * 0.1
        clock.received(7.0 + step)  # ten times real time
    wall.now_s += 0.05
    assert clock.boot_s() == pytest.approx(36.5, abs=0.1)


def test_it_goes_on_while_the_vehicle_sends_anything():
    wall = Wall()
    clock = VehicleClock(monotonic=wall)
    clock.received(10.0)
    for _ in range(60):
        wall.now_s += 1.0
        clock.received(10.0)  # a stream that is frozen
        clock.alive()
    assert clock.boot_s() == pytest.approx(70.0)
    wall.now_s += 1000.0  # and then it is silent
    clock.alive()
    assert clock.boot_s() == pytest.approx(72.0)


def test_it_never_runs_backwards_when_a_message_is_late():
    wall = Wall()
    clock = VehicleClock(monotonic=wall)
    clock.received(10.0)
    wall.now_s += 1.0
    ahead_s = clock.boot_s()
    clock.received(10.5)
    assert clock.boot_s() >= ahead_s


def test_a_rebooted_vehicle_starts_anew():
    wall = Wall()
    clock = VehicleClock(monotonic=wall)
    clock.received(500.0)
    assert clock.boot_s() == 500.0
    wall.now_s += 5.0
    clock.received(2.0)
    assert clock.boot_s() == pytest.approx(2.0)


def test_a_unix_time_that_was_set_since_counts_once_it_runs_with_the_vehicle_s_clock():
    """A PX4 without a fix sends the time of its own clock; with one, that of the satellites."""
    clock = VehicleClock(monotonic=Wall(), unix=lambda: 5e8)
    clock.received(10.0)
    clock.received_unix(1.2e9, 10.0)
    times_s = []
    for boot_s, unix_s in (
        (11.0, 1.7e9),
        (11.0, 1.7e9),
        (12.0, 1.2e9),
        (13.0, 1.7e9),
        (14.0, 1.7e9 + 1),
    ):
        clock.received(boot_s)
        clock.received_unix(unix_s, boot_s)
        times_s.append(clock.now_s())
    assert times_s == pytest.approx([1.2e9 + 1, 1.2e9 + 1, 1.2e9 + 2, 1.2e9 + 3, 1.7e9 + 1])


def test_unix_time_is_the_vehicle_s_once_it_is_received():
    clock = VehicleClock(monotonic=Wall(), unix=lambda: 5e8)
    clock.received(10.0)
    assert clock.now_s() == pytest.approx(5e8)
    clock.received_unix(1.7e9, 10.0)
    assert clock.now_s() == pytest.approx(1.7e9)


def test_a_simulated_gps_that_runs_at_another_rate_is_believed_once():
    clock = VehicleClock(monotonic=Wall(), unix=lambda: 5e8)
    for second in range(10):
        clock.received(10.0 * second)
        clock.received_unix(1.7e9 + second, 10.0 * second)
    assert clock.now_s() == pytest.approx(1.7e9 + 90.0)


def test_a_simulation_that_waits_for_us_is_ahead_by_no_more_than_it_may():
    wall = Wall()
    clock = VehicleClock(monotonic=wall, ceiling=25.0)
    for step in range(30):
        wall.now_s = 100.0 + step * 0.1
        clock.received(7.0 + 0.3 * step)  # it waits most of the time
    assert clock.rate == 25.0
    for step in range(30):
        wall.now_s = 103.0 + step * 0.1
        clock.received(17.0 + 2.5 * step)
    received_s = clock.boot_s()
    wall.now_s += 0.3  # busy: at 25 times real time that would be 7.5 s
    assert clock.boot_s() == pytest.approx(received_s + PACE_ALLOWANCE_S)


@pytest.mark.parametrize("stall_s", [0.5, 1.0, 1.9])
def test_a_link_that_stalls_and_then_delivers_all_at_once_does_not_change_the_rate(stall_s):
    wall = Wall()
    clock = VehicleClock(monotonic=wall)
    clock.received(7.0)
    waiting = []
    for step in range(1, 300):
        wall.now_s = 100.0 + step * 0.1
        waiting.append(7.0 + step * 0.1)
        if step < 30 or step % 30 * 0.1 >= stall_s:
            for boot_s in waiting:
                clock.received(boot_s)
            waiting.clear()
        wall.now_s += 0.05
        assert clock.boot_s() == pytest.approx(7.05 + step * 0.1, abs=0.15)
    assert clock.rate == pytest.approx(1.0, abs=0.1)
