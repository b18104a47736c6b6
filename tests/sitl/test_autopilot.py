"""Flights of the simulated autopilot, judged by what a real PX4 1.17 did."""

import math
from itertools import pairwise

import pytest

AMSL = 489.4
TEMPORARILY_REJECTED, DENIED, UNSUPPORTED = 1, 2, 3
HOLD, TAKEOFF, MISSION, RTL, LAND = 3, 2, 4, 5, 6
SQUARE = [(40, -20), (40, 20), (60, 20), (60, -20)]


def set_mode(rig, sub, main=4):
    return rig.command(176, 1, main, sub)


def start_mission(rig, *items):
    assert rig.upload(list(items))[-1] == ("ACK", 0)
    assert set_mode(rig, MISSION) == [0, 0]


def current(rig):
    return rig.onboard.last("MISSION_CURRENT")


class TestArming:
    def test_refused_before_the_vehicle_is_healthy(self, rig):
        rig.run(3)
        assert rig.command(400, 1) == [TEMPORARILY_REJECTED]
        assert "Arming denied: Resolve system health failures first" in rig.ground.texts()
        assert rig.onboard.said("commander_arm_denied_resolve_failures")
        assert rig.run(3, lambda: rig.autopilot.can_arm)
        assert rig.now_s == pytest.approx(4.5, abs=0.1)
        assert rig.command(400, 1) == [0]

    def test_twice_is_fine_and_without_a_takeoff_it_disarms_itself(self, rig):
        rig.ready()
        assert rig.command(400, 1) == [0]
        armed_s = rig.now_s
        assert rig.command(400, 1) == [0]
        assert rig.run(15, lambda: not rig.autopilot.armed)
        assert rig.now_s - armed_s == pytest.approx(10.9, abs=0.5)  # 11.1 s recorded
        rig.run(0.1)
        assert "Disarmed by auto preflight disarming" in rig.ground.texts()

    def test_home_is_where_it_was_armed(self, rig):
        rig.ready()
        assert rig.autopilot.situation.home == pytest.approx((0, 0), abs=0.5)
        rig.command(400, 1)
        position = rig.autopilot.situation
        assert position.home == pytest.approx((position.north_m, position.east_m), abs=0.2)

    @pytest.mark.parametrize("sub", [RTL, LAND])
    def test_return_and_land_prevent_it(self, rig, sub):
        rig.ready()
        assert set_mode(rig, sub) == [0, 0]
        assert rig.command(400, 1) == [TEMPORARILY_REJECTED]

    def test_without_a_ground_station_if_its_loss_is_a_failsafe(self, make_rig):
        rig = make_rig(NAV_DLL_ACT=2)
        rig.heartbeats = False
        rig.ready()
        assert rig.command(400, 1) == [TEMPORARILY_REJECTED]

    def test_not_to_be_disarmed_in_the_air_unless_forced(self, rig):
        rig.fly(5)
        assert rig.command(400, 0) == [TEMPORARILY_REJECTED]
        assert "Disarming denied: not landed" in rig.ground.texts()
        assert rig.command(400, 0, 21196) == [0]
        rig.run(5)
        assert rig.position()[2] == 0


class TestModes:
    def test_every_mode_change_is_answered_twice(self, rig):
        rig.ready()
        rig.onboard.clear()
        rig.send("command_long", 1, 1, 176, 0, 1, 4, RTL, *(math.nan,) * 4)
        assert [ack.result for ack in rig.onboard.all("COMMAND_ACK")] == [0]
        rig.run(0.04)
        assert [ack.result for ack in rig.onboard.all("COMMAND_ACK")] == [0, 0]

    @pytest.mark.parametrize(("main", "sub", "label"), [(4, 4, "Mission"), (6, 0, "Offboard")])
    def test_one_that_cannot_be_flown_is_accepted_and_then_rejected(self, rig, main, sub, label):
        rig.fly()
        assert set_mode(rig, sub, main) == [0, TEMPORARILY_REJECTED]
        assert rig.mode == "AUTO_LOITER"
        assert f"Switching to {label} is currently not available" in rig.ground.texts()

    def test_a_companion_gets_no_words_for_that(self, rig):
        rig.fly()
        rig.command(176, 1, 4, 4, source=(1, 191))
        assert not any("Mission is currently" in text for text in rig.ground.texts())

    def test_sticks_modes_need_a_pilot_in_the_air(self, rig):
        rig.ready()
        assert set_mode(rig, 0, 3) == [0, 0]
        assert set_mode(rig, HOLD) == [0, 0]
        rig.fly()
        assert set_mode(rig, 0, 3) == [0, TEMPORARILY_REJECTED]

    def test_nonsense(self, rig):
        rig.ready()
        assert set_mode(rig, 0, 99) == [0, 0]
        assert set_mode(rig, 77) == [0, TEMPORARILY_REJECTED]
        assert "Unsupported auto mode" in rig.ground.texts()
        assert rig.command(176, 0, 4, 3) == [0, 0]
        rig.run(0.2)
        assert rig.mode == "AUTO_LOITER"

    def test_set_mode_the_message_is_answered_once(self, rig):
        rig.ready()
        rig.onboard.clear()
        rig.send("set_mode", 1, 1, 5 << 24 | 4 << 16)
        rig.run(0.2)
        assert [ack.result for ack in rig.onboard.all("COMMAND_ACK")] == [0]
        assert rig.mode == "AUTO_RTL"

    def test_the_mode_shows_within_a_second_in_the_heartbeat(self, rig):
        rig.ready()
        rig.run(0.5)
        set_mode(rig, RTL)
        changed_s = rig.now_s
        assert rig.run(
            2,
            lambda: any(beat.custom_mode == 0x05040000 for beat in rig.onboard.all("HEARTBEAT")),
        )
        assert rig.now_s - changed_s <= 1.0
        assert rig.onboard.last("HEARTBEAT").system_status == 0  # it cannot be armed like that

    def test_takeoff_while_disarmed_then_arm_takes_off(self, rig):
        rig.ready()
        assert rig.command(22) == [0]
        assert rig.mode == "AUTO_TAKEOFF"
        assert rig.command(400, 1) == [0]
        assert rig.run(10, lambda: not rig.landed)
        assert "Using default takeoff altitude: 2.5 m" in rig.ground.texts()


class TestTakeoff:
    def test_climbs_at_one_and_a_half_and_holds_there(self, rig):
        rig.ready()
        assert rig.command(400, 1) == [0]
        assert rig.command(22, *(math.nan,) * 6, AMSL + 20) == [0]
        begun_s = rig.now_s
        assert rig.run(10, lambda: not rig.landed)
        assert 0.5 < rig.now_s - begun_s < 2.5  # 0.8 to 2.1 s recorded
        assert rig.run(40, lambda: rig.mode == "AUTO_LOITER")
        assert rig.now_s - begun_s == pytest.approx(17, abs=2)  # 16 s recorded
        rig.run(5)
        assert rig.position()[2] == pytest.approx(20, abs=1)
        assert rig.onboard.last("EXTENDED_SYS_STATE").landed_state == 2

    def test_land_and_disarm_two_seconds_later(self, rig):
        rig.fly(10)
        assert set_mode(rig, LAND) == [0, 0]
        begun_s = rig.now_s
        rig.run(1)
        assert rig.onboard.last("EXTENDED_SYS_STATE").landed_state == 4
        assert rig.run(40, lambda: rig.landed)
        landed_s = rig.now_s
        assert 10 < landed_s - begun_s < 20
        assert rig.run(5, lambda: not rig.autopilot.armed)
        assert rig.now_s - landed_s == pytest.approx(2, abs=0.1)
        rig.run(0.1)
        assert rig.ground.texts()[-2:] == ["Landing detected", "Disarmed by landing"]
        assert rig.mode == "AUTO_LOITER"


class TestMission:
    def test_flies_to_a_node_and_holds_until_it_is_sent_on(self, rig):
        rig.ready()
        assert rig.command(400, 1) == [0]
        start_mission(
            rig,
            rig.item(0, 0, 0, 15, 22, current=1),
            rig.item(1, 40, 0, 15, go_on=0),
            rig.item(2, 40, 40, 15, go_on=0),
        )
        assert rig.run(60, lambda: rig.autopilot.mission.index == 1)
        assert rig.position()[2] > 13

        def reached(item):
            said = rig.onboard.all("MISSION_ITEM_REACHED")
            return sum(message.seq == item for message in said)

        rig.onboard.clear()
        assert rig.run(30, lambda: reached(1))
        assert rig.away_m(40, 0) < 2.3
        rig.run(30)
        assert reached(1) == 11  # said once, and ten times more
        assert 0 < reached(0) <= 10
        assert rig.mode == "AUTO_MISSION"
        assert rig.away_m(40, 0) < 0.5
        assert (current(rig).seq, current(rig).state) == (1, 3)

        rig.onboard.clear()
        rig.send("mission_set_current", 1, 1, 2)
        rig.run(0.1)
        assert current(rig).seq == 2
        assert rig.run(30, lambda: reached(2))
        assert rig.away_m(40, 40) < 2.3

    def test_a_jump_in_mid_leg_flies_straight_from_where_it_is(self, rig):
        rig.fly(15)
        start_mission(
            rig,
            rig.item(0, 80, 0, 15, go_on=0),
            rig.item(1, 40, 60, 15, go_on=0),
        )
        rig.run(50, lambda: rig.position()[0] > 40)
        start = rig.position()[:2]
        rig.send("mission_set_current", 1, 1, 1)
        track = []
        rig.run(40, lambda: track.append(rig.position()[:2]) or rig.away_m(40, 60) < 2.5)
        overshoot = [point for point in track if point[1] > 15]
        assert max(point[0] for point in overshoot) < start[0] + 10
        assert min(point[0] for point in overshoot) > 38

    def test_with_autocontinue_it_goes_on_and_ends_in_hold(self, rig):
        rig.fly(15)
        start_mission(rig, rig.item(0, 20, 0, 15), rig.item(1, 20, 20, 15))
        assert rig.run(40, lambda: rig.mode == "AUTO_LOITER")
        rig.run(1.1)
        assert "Mission finished, loitering" in rig.ground.texts()
        assert current(rig).state == 5
        assert rig.away_m(20, 20) < 2.5

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

    def test_uploaded_in_flight_without_a_marked_item_it_keeps_its_index(self, rig):
        rig.fly(15)
        items = [rig.item(number, 20 * number, 20, 15, go_on=0) for number in range(3)]
        start_mission(rig, *items)
        rig.send("mission_set_current", 1, 1, 2)
        rig.run(3)
        changed = [rig.item(number, 20 * number, 30, 15, go_on=0) for number in range(3)]
        assert rig.upload(changed)[-1] == ("ACK", 0)
        rig.run(1.1)
        assert (current(rig).seq, rig.mode) == (2, "AUTO_MISSION")
        marked = [rig.item(n, 20 * n, 35, 15, go_on=0, current=int(n == 0)) for n in range(3)]
        assert rig.upload(marked)[-1] == ("ACK", 0)
        rig.run(1.1)
        assert current(rig).seq == 0

    def test_cleared_in_flight_it_holds(self, rig):
        rig.fly(15)
        start_mission(rig, rig.item(0, 90, 20, 15))
        rig.run(3)
        rig.send("mission_clear_all", 1, 1, 0)
        rig.run(1.1)
        assert rig.mode == "AUTO_LOITER"
        assert "No valid mission available, loitering" in rig.ground.texts()

    def test_hold_and_resume(self, rig):
        rig.fly(15)
        start_mission(rig, rig.item(0, 20, 0, 15), rig.item(1, 90, 0, 15, go_on=0))
        rig.run(30, lambda: rig.position()[0] > 40)
        assert set_mode(rig, HOLD) == [0, 0]
        rig.run(10)
        stopped = rig.position()[0]
        assert 44 < stopped < 50
        rig.send("mission_set_current", 1, 1, 0)
        rig.run(3)
        assert rig.position()[0] == pytest.approx(stopped, abs=0.5)  # the index alone moves nothing
        assert set_mode(rig, MISSION) == [0, 0]
        assert rig.run(20, lambda: rig.position()[0] < 30)

    def test_start_without_a_mission(self, rig):
        rig.ready()
        assert rig.command(300, 0, 0) == [DENIED]
        assert "Mission start denied! No valid mission" in rig.ground.texts()

    def test_mission_start_arms(self, rig):
        rig.ready()
        rig.upload([rig.item(0, 0, 0, 15, 22)])
        rig.run(0.2)
        assert rig.command(300, 0, 0) == [0]
        assert rig.autopilot.armed
        assert rig.mode == "AUTO_MISSION"


class TestReposition:
    def test_is_always_amsl_whatever_the_frame(self, rig):
        rig.fly(15)
        assert rig.reposition(0, 20, AMSL + 25, frame=6) == [0]
        rig.run(20)
        assert rig.position()[2] == pytest.approx(25, abs=1)
        assert rig.reposition(0, 20, 20, frame=6) == [0]  # 20 m AMSL, meant as 20 m above home
        assert rig.run(60, lambda: rig.landed)

    def test_needs_the_change_mode_flag(self, rig):
        rig.fly()
        assert rig.reposition(30, 0, AMSL + 15, flags=0) == [UNSUPPORTED]
        rig.run(5)
        assert rig.away_m(0, 0) < 1

    def test_nan_keeps_the_height_and_no_place_keeps_the_place(self, rig):
        rig.fly()
        assert rig.reposition(30, 0, math.nan) == [0]
        rig.run(15)
        assert rig.position() == pytest.approx((30, 0, 15), abs=1)
        nothing = 2**31 - 1
        rig.send("command_int", 1, 1, 5, 192, 0, 0, -1, 1, 0, math.nan, nothing, nothing, AMSL + 22)
        rig.run(10)
        assert rig.position() == pytest.approx((30, 0, 22), abs=1)

    def test_nothing_at_all_stops_it_however_slow_it_is(self, rig):
        rig.fly()
        assert rig.reposition(30, 0, math.nan) == [0]
        rig.run(0.1)
        nothing = 2**31 - 1
        unsaid = (math.nan, nothing, nothing, math.nan)
        rig.send("command_int", 1, 1, 5, 192, 0, 0, -1, 1, 0, *unsaid)
        rig.run(10)
        assert rig.position()[:2] == pytest.approx((0, 0), abs=2)

    def test_on_the_ground_it_is_accepted_and_nothing_moves(self, rig):
        rig.ready()
        assert rig.reposition(30, 0, AMSL + 15) == [0]
        rig.command(400, 1)
        rig.run(5)
        assert rig.landed

    def test_the_speed_that_was_set_lasts_until_the_mode_changes(self, rig):
        rig.fly()
        assert rig.command(178, 1, 2, -1) == [0]
        rig.reposition(60, 0, math.nan)
        rig.run(5)
        assert rig.autopilot.situation.velocity_m_s[0] == pytest.approx(1.8, abs=0.3)
        set_mode(rig, RTL)
        rig.run(6)
        assert rig.autopilot.situation.cruise_m_s == 5


class TestFence:
    def fly_by(self, rig):
        rig.ready()
        assert rig.upload(rig.fence(SQUARE), 1)[-1] == ("ACK", 0)
        rig.fly()

    def test_in_force_some_time_after_its_acknowledgement(self, rig):
        rig.fly()
        rig.upload(rig.fence(SQUARE), 1)
        assert rig.reposition(50, 0, math.nan) == [0]
        assert "Reposition is outside geofence" not in rig.ground.texts()
        rig.reposition(0, 0, math.nan)
        rig.run(0.4)
        assert rig.reposition(50, 0, math.nan) == [0]
        assert "Reposition is outside geofence" in rig.ground.texts()

    def test_a_reposition_into_it_is_acknowledged_and_not_flown(self, rig):
        self.fly_by(rig)
        assert rig.reposition(50, 0, math.nan) == [0]
        rig.run(10)
        assert rig.away_m(0, 0) < 1
        assert rig.onboard.said("navigator_reposition_outside_geofence")

    def test_entered_it_holds_overshoots_and_comes_back_to_the_edge(self, rig):
        self.fly_by(rig)
        assert rig.reposition(80, 0, math.nan) == [0]
        furthest = []
        assert rig.run(
            30, lambda: furthest.append(rig.position()[0]) or rig.autopilot.failsafe.acting
        )
        rig.run(20, lambda: furthest.append(rig.position()[0]))
        assert 45 < max(furthest) < 49  # 47.6 m recorded
        assert 39.5 < rig.position()[0] < 42  # 40.5 m recorded
        assert rig.mode == "AUTO_LOITER"
        assert rig.onboard.last("HEARTBEAT").system_status == 5
        assert "Geofence: approaching or outside geofence" in rig.ground.texts()
        assert "Failsafe activated" in rig.ground.texts()
        assert rig.onboard.said("commander_failsafe_enter_generic")
        assert rig.reposition(0, 0, math.nan) == [0]
        assert rig.onboard.said("failsafe_rc_override")
        rig.run(20)
        assert rig.away_m(0, 0) < 1
        assert rig.onboard.last("HEARTBEAT").system_status == 4

    def test_a_mission_across_it_is_stopped_once_and_then_flown_through(self, rig):
        self.fly_by(rig)
        start_mission(rig, rig.item(0, 10, 0, 15), rig.item(1, 90, 0, 15, go_on=0))
        rig.run(1.1)
        assert current(rig).state == 3  # only points are looked at
        assert rig.run(40, lambda: rig.autopilot.failsafe.acting)
        rig.run(2.1)
        assert rig.mode == "AUTO_LOITER"
        modes = rig.onboard.last("CURRENT_MODE")
        assert (modes.custom_mode, modes.intended_custom_mode) == (0x03040000, 0x04040000)
        assert current(rig).state == 4
        assert set_mode(rig, MISSION) == [0, 0]
        assert rig.run(40, lambda: rig.position()[0] > 80)
        assert not rig.autopilot.failsafe.acting

    def test_a_waypoint_inside_is_accepted_and_makes_the_mission_invalid(self, rig):
        rig.ready()
        rig.upload(rig.fence(SQUARE), 1)
        rig.run(1)
        assert rig.upload([rig.item(0, 0, 0, 15, 22), rig.item(1, 50, 0, 15)])[-1] == ("ACK", 0)
        rig.run(1.1)
        assert current(rig).state == 1
        assert "Geofence violation for waypoint 2" in rig.ground.texts()
        assert rig.command(400, 1) == [0]
        assert rig.command(300, 0, 0) == [DENIED]
        assert set_mode(rig, MISSION) == [0, TEMPORARILY_REJECTED]

    def test_a_fence_that_comes_later_makes_a_mission_invalid(self, rig):
        rig.ready()
        rig.upload([rig.item(0, 0, 0, 15, 22), rig.item(1, 50, 0, 15)])
        rig.run(1.1)
        assert current(rig).state == 2
        rig.upload(rig.fence(SQUARE), 1)
        rig.run(1.5)
        assert current(rig).state == 1

    def test_one_around_home_is_left_out(self, rig):
        rig.ready()
        box = [(-10, -10), (-10, 10), (10, 10), (10, -10)]
        assert rig.upload(rig.fence(box), 1)[-1] == ("ACK", 0)
        rig.run(1)
        assert "Geofence invalid, doesn't contain Home position" in rig.ground.texts()
        assert rig.command(400, 1) == [0]

    def test_inclusions_and_circles(self, rig):
        rig.ready()
        box = [(-30, -30), (-30, 30), (30, 30), (30, -30)]
        circle = rig.item(4, 20, 0, 0, 5004, frame=0, params=(5, 0, 0, 0), type=1)
        assert rig.upload([*rig.fence(box, 5001), circle], 1)[-1] == ("ACK", 0)
        rig.run(1)
        fence = rig.autopilot.guard.fence
        assert fence.allows(0, 0)
        assert not fence.allows(40, 0)
        assert not fence.allows(18, 0)
        assert fence.allows(26, 0)

    def test_return_instead_of_hold(self, make_rig):
        rig = make_rig(GF_ACTION=3)
        self.fly_by(rig)
        rig.reposition(80, 0, math.nan)
        assert rig.run(40, lambda: rig.mode == "AUTO_RTL")


class TestReturn:
    def test_climbs_goes_home_lands_and_disarms(self, rig):
        rig.fly(15)
        rig.reposition(50, 0, math.nan)
        rig.run(20)
        assert rig.command(20) == [0]
        rig.run(0.2)
        assert any(text.startswith("RTL: start return at ") for text in rig.ground.texts())
        heights, climbed = [], []

        def watch():
            north, _, up = rig.position()
            heights.append(up)
            if north > 45:
                climbed.append(up)
            return not rig.autopilot.armed

        assert rig.run(150, watch)
        assert max(heights) == pytest.approx(30, abs=1.5)
        assert max(climbed) > 28  # it climbs first
        assert rig.away_m(0, 0) < 2

    def test_close_to_home_it_does_not_climb_so_high(self, rig):
        rig.fly(10)
        rig.reposition(5, 0, math.nan)
        rig.run(10)
        set_mode(rig, RTL)
        heights = []
        rig.run(60, lambda: heights.append(rig.position()[2]) or rig.landed)
        assert max(heights) < 12

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
    def test_battery_warning_return_and_land(self, make_rig):
        rig = make_rig(
            SIM_BAT_DRAIN=400.0, BAT_LOW_THR=0.85, BAT_CRIT_THR=0.77, BAT_EMERGEN_THR=0.72
        )
        rig.fly(20)
        rig.reposition(60, 0, math.nan)
        battery = rig.autopilot.battery
        assert rig.run(400, lambda: battery.remaining < 0.849)
        rig.run(0.1)
        assert rig.ground.texts()[-1] == "Low battery"
        assert rig.mode == "AUTO_LOITER"
        assert not rig.autopilot.failsafe.acting
        assert rig.run(100, lambda: rig.autopilot.failsafe.acting)
        assert battery.remaining == pytest.approx(0.77, abs=0.001)
        assert "Failsafe activated: entering Hold for 5 seconds" in [
            *rig.ground.texts(),
            *late(rig),
        ]
        held_s = rig.now_s
        assert rig.run(10, lambda: rig.mode == "AUTO_RTL")
        assert rig.now_s - held_s == pytest.approx(5, abs=0.1)
        rig.run(2.1)
        assert rig.onboard.last("BATTERY_STATUS").charge_state == 3
        assert rig.run(20, lambda: rig.mode == "AUTO_LAND")
        assert battery.remaining == pytest.approx(0.72, abs=0.001)

    def test_a_mode_command_takes_over_from_the_battery_failsafe(self, make_rig):
        rig = make_rig(SIM_BAT_DRAIN=300.0, BAT_CRIT_THR=0.8)
        rig.fly(10)
        assert rig.run(300, lambda: rig.autopilot.failsafe.acting)
        assert set_mode(rig, HOLD) == [0, 0]
        rig.run(7)
        assert rig.mode == "AUTO_LOITER"
        assert not rig.autopilot.failsafe.acting

    def test_full_again_on_the_ground(self, rig):
        rig.fly(5)
        assert rig.autopilot.battery.remaining < 1
        set_mode(rig, LAND)
        rig.run(40, lambda: not rig.autopilot.armed)
        rig.run(0.1)
        assert rig.autopilot.battery.remaining == 1

    def test_a_silent_ground_station_is_mentioned_only(self, rig):
        rig.fly()
        rig.heartbeats = False
        rig.run(20)
        assert rig.onboard.said("commander_gcs_lost")
        assert rig.mode == "AUTO_LOITER"

    def test_or_brought_home_for_if_that_is_set(self, make_rig):
        rig = make_rig(NAV_DLL_ACT=2)
        rig.fly()
        rig.reposition(50, 0, math.nan)
        rig.run(15)
        rig.heartbeats = False
        silent_s = rig.now_s
        assert rig.run(30, lambda: rig.autopilot.failsafe.acting)
        assert rig.now_s - silent_s == pytest.approx(12, abs=1.1)
        assert rig.run(30, lambda: rig.mode == "AUTO_RTL")
        assert rig.now_s - silent_s == pytest.approx(17, abs=1.1)
        rig.heartbeats = True
        rig.run(3)
        assert rig.mode == "AUTO_RTL"  # its return changes nothing
        assert set_mode(rig, HOLD) == [0, 0]
        rig.run(1)
        assert rig.mode == "AUTO_LOITER"

    def test_a_silent_companion_is_mentioned(self, rig):
        rig.fly()
        rig.send("heartbeat", 18, 8, 0, 0, 0, source=(1, 191))
        rig.run(8)
        assert "Connection to mission computer lost" in rig.ground.texts()
        assert rig.mode == "AUTO_LOITER"
        rig.send("heartbeat", 18, 8, 0, 0, 0, source=(1, 191))
        rig.run(0.1)
        assert "Onboard controller regained" in rig.ground.texts()

    def test_termination_is_for_good(self, rig):
        rig.ready()
        assert rig.command(185, 1) == [DENIED]
        rig.fly(5)
        assert rig.command(185, 1) == [0]
        rig.run(5)
        assert rig.position()[2] == 0
        assert set_mode(rig, HOLD) == [0, TEMPORARILY_REJECTED]


def late(rig):
    rig.run(0.1)
    return rig.ground.texts()


def test_the_estimate_is_near_the_truth_and_the_seed_decides_how(make_rig):
    def errors(seed):
        rig = make_rig(seed=seed)
        rig.run(60)
        situation = rig.autopilot.situation
        return situation.north_m, situation.east_m

    assert errors(1) == errors(1) != errors(2)
    rig = make_rig()
    sizes = []
    rig.run(200, lambda: sizes.append(rig.autopilot.errors.north_m))
    sigma = math.sqrt(sum(size * size for size in sizes) / len(sizes))
    assert 0.05 < sigma < 0.2


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
