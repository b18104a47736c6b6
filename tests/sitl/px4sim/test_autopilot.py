"""What the simulated autopilot does beyond the recorded conversations (test_conformance)."""

import math
from itertools import pairwise

import pytest

from sitl.px4sim.motion.estimator import EstimateErrors

HOLD, MISSION, RTL, LAND = 3, 4, 5, 6


def set_mode(rig, sub, main=4):
    return rig.command(176, 1, main, sub)


def start_mission(rig, *items):
    assert rig.upload(list(items))[-1] == ("ACK", 0)
    assert set_mode(rig, MISSION) == [0, 0]


class TestArming:
    def test_home_is_where_it_was_armed(self, rig):
        rig.ready()
        assert rig.autopilot.situation.home == pytest.approx((0, 0), abs=0.5)
        rig.command(400, 1)
        position = rig.autopilot.situation
        assert position.home == pytest.approx((position.north_m, position.east_m), abs=0.2)


class TestMission:
    def test_an_acceptance_radius_of_its_own_and_a_hold_time(self, rig):
        rig.fly(15)
        start_mission(
            rig, rig.item(0, 60, 0, 15, params=(4, 10, 0, math.nan)), rig.item(1, 0, 0, 15)
        )
        rig.run(40, lambda: rig.away_m(60, 0) < 10)
        inside_s = rig.now_s
        assert rig.run(20, lambda: rig.autopilot.mission.index == 1)
        assert rig.now_s - inside_s == pytest.approx(4, abs=0.3)

    def test_speed_jump_and_return_items(self, rig):
        rig.fly(15)
        faster = rig.item(1, 0, 0, 0, 178, frame=2, x=0, y=0, params=(1, 8, -1, 0))
        back = rig.item(3, 0, 0, 0, 177, frame=2, x=0, y=0, params=(2, 1, 0, 0))
        home = rig.item(4, 0, 0, 0, 20, frame=2, x=0, y=0, params=(0, 0, 0, 0))
        start_mission(rig, rig.item(0, 20, 0, 15), faster, rig.item(2, 90, 0, 15), back, home)
        speeds, items = [], []

        def watch():
            speeds.append(math.hypot(*rig.autopilot.situation.velocity_m_s[:2]))
            items.append(rig.autopilot.mission.index)
            return rig.mode == "AUTO_RTL"

        assert rig.run(90, watch)
        assert 6.5 < max(speeds) < 8.2  # the drag has to be learned first, as on PX4's simulator
        assert [b for a, b in pairwise(items) if a != b][:3] == [1, 2, 4]
        rig.run(0.2)
        assert "Returning to launch" in rig.ground.texts()

    def test_land_item(self, rig):
        rig.fly(15)
        start_mission(rig, rig.item(0, 20, 0, 15), rig.item(1, 30, 0, 0, 21))
        assert rig.run(120, lambda: not rig.autopilot.armed)
        assert rig.away_m(30, 0) < 1

    def test_mission_start_arms(self, rig):
        rig.ready()
        rig.upload([rig.item(0, 0, 0, 15, 22)])
        rig.run(0.2)
        assert rig.command(300, 0, 0) == [0]
        assert rig.autopilot.armed
        assert rig.mode == "AUTO_MISSION"


class TestReposition:
    def test_the_speed_that_was_set_lasts_until_the_mode_changes(self, rig):
        rig.fly()
        assert rig.command(178, 1, 2, -1) == [0]
        rig.reposition(60, 0, math.nan)
        rig.run(5)
        assert rig.autopilot.situation.velocity_m_s[0] == pytest.approx(1.8, abs=0.3)
        set_mode(rig, RTL)
        rig.run(6)
        assert rig.autopilot.situation.cruise_m_s == 5


class TestReturn:
    def test_to_a_nearer_rally_point(self, rig):
        rig.ready()
        rally = rig.item(0, 60, 0, 0, 5100, params=(0, 0, 0, 0), type=2)
        assert rig.upload([rally], 2)[-1] == ("ACK", 0)
        rig.fly(15)
        rig.reposition(50, 0, math.nan)
        rig.run(20)
        set_mode(rig, RTL)
        assert rig.run(150, lambda: not rig.autopilot.armed)
        assert rig.away_m(60, 0) < 2


class TestFailsafes:
    def test_full_again_on_the_ground(self, rig):
        rig.fly(5)
        assert rig.autopilot.battery.remaining < 1
        set_mode(rig, LAND)
        rig.run(40, lambda: not rig.autopilot.armed)
        rig.run(0.1)
        assert rig.autopilot.battery.remaining == 1


def test_the_estimate_is_near_the_truth_and_the_seed_decides_how():
    def errors(seed):
        errors = EstimateErrors(seed)
        for _ in range(10_000):
            errors.step(0.02, in_air=True)
            yield errors.north_m

    sizes = [*errors(1)]
    assert sizes == [*errors(1)] != [*errors(2)]
    assert 0.05 < math.sqrt(sum(size * size for size in sizes) / len(sizes)) < 0.2


@pytest.mark.parametrize("sub", [HOLD, MISSION, RTL, LAND])
@pytest.mark.parametrize(("override", "position"), [(1, True), (0, False)])
def test_moved_sticks_take_every_automatic_mode_over_if_they_may(make_rig, sub, override, position):
    rig = make_rig(COM_RC_OVERRIDE=override)
    rig.fly()
    assert rig.upload([rig.item(0, 60, 0, 15)])[-1] == ("ACK", 0)
    assert set_mode(rig, sub) == [0, 0]
    rig.run(1)
    mode = rig.mode
    for pitch in (0, 0, 600, 600):
        rig.send("manual_control", 1, pitch, 0, 500, 0, 0)
        rig.run(0.2)
    assert rig.mode == ("POSCTL" if position else mode)
    assert ("Pilot took over using sticks" in rig.ground.texts()) is position
