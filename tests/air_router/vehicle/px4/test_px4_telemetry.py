import pytest

from air_router.vehicle.clock import VehicleClock
from air_router.vehicle.height_frame import HomeMove
from air_router.vehicle.px4.px4_events import event_id
from air_router.vehicle.px4.px4_streams import ARMED
from air_router.vehicle.px4.px4_telemetry import Px4Telemetry
from air_router.vehicle.vehicle import FlightMode, ItemReached, PlanReplaced
from geo.frame import Point

HOLD, MISSION, POSITION = 0x03040000, 0x04040000, 0x00030000


class Vehicle:
    """Messages of a PX4 handed straight to what listens to them."""

    def __init__(self, frame):
        self.telemetry = Px4Telemetry(frame, VehicleClock())
        self.events = []
        self._handlers = {}
        self.telemetry.listen(self, 1)
        self.telemetry.subscribe(self.events.append)

    def says(self, name, **fields):
        getattr(self.telemetry, name)(fields)

    def subscribe_message(self, name, callback):
        self._handlers[name] = callback

    def beats(self, mode):
        self.says("_on_heartbeat", custom_mode=mode, base_mode=ARMED, system_status=4)

    def is_at(self, lat, lon, time_ms=1000, amsl_m=50.0, above_home_m=40.0):
        self.says(
            "_on_position",
            time_boot_ms=time_ms,
            lat=lat,
            lon=lon,
            alt=round(amsl_m * 1000),
            relative_alt=round(above_home_m * 1000),
            vx=100,
            vy=-200,
            vz=0,
            hdg=65535,
        )


@pytest.fixture
def vehicle(pennovation, event_loop_running):
    return event_loop_running(lambda: Vehicle(pennovation.frame))


@pytest.fixture
def event_loop_running():
    import asyncio  # noqa: PLC0415

    def inside(make):
        async def script():
            return make()

        return asyncio.run(script())

    return inside


def test_a_position_becomes_telemetry(vehicle, pennovation):
    latitude_deg, longitude_deg = pennovation.frame.to_geodetic(pennovation.home)
    vehicle.is_at(round(latitude_deg * 1e7), round(longitude_deg * 1e7))
    assert vehicle.events == []  # nothing is known of its mode yet
    vehicle.beats(MISSION)
    (told,) = vehicle.events
    assert told.position == pytest.approx(pennovation.home, abs=0.02)
    assert told.velocity_m_s == (-2.0, 1.0)  # east, north
    assert (told.time_s, told.altitude_m, told.heading_deg) == (1.0, 40.0, None)
    assert told.armed
    assert told.mode is FlightMode.MISSION


def test_a_mode_is_told_the_moment_that_it_changes(vehicle):
    vehicle.is_at(399_400_000, -752_000_000)
    for mode in (MISSION, MISSION, HOLD, POSITION):
        vehicle.beats(mode)
    vehicle.says("_on_current_mode", custom_mode=MISSION)
    modes = [event.mode for event in vehicle.events]
    assert modes == [FlightMode.MISSION, FlightMode.HOLD, FlightMode.POSITION, FlightMode.MISSION]


def test_a_position_that_is_none_is_left_out(vehicle):
    vehicle.beats(MISSION)
    vehicle.is_at(2_000_000_000, 0)
    assert vehicle.events == []
    vehicle.is_at(399_400_000, -752_000_000, time_ms=2000)
    assert [event.time_s for event in vehicle.events] == [2.0]


class InFlight:
    """One that took off with its home 489 m above the sea, and hovers 40 m above that."""

    def __init__(self, vehicle, frame, home):
        self.vehicle, self._frame, self._home = vehicle, frame, home
        self.beats_at_home(489.0)
        vehicle.says("_on_extended_state", landed_state=1)
        self.reads(489.0, 0.0)
        vehicle.says("_on_extended_state", landed_state=2)
        self.reads(529.0, 40.0)

    def beats_at_home(self, amsl_m, east_m=0.0):
        self.vehicle.beats(MISSION)
        place = Point(self._home.east_m + east_m, self._home.north_m)
        latitude_deg, longitude_deg = self._frame.to_geodetic(place)
        self.vehicle.says(
            "_on_home",
            latitude=round(latitude_deg * 1e7),
            longitude=round(longitude_deg * 1e7),
            altitude=round(amsl_m * 1000),
        )

    def reads(self, amsl_m, above_home_m):
        self.vehicle.is_at(399_400_000, -752_000_000, amsl_m=amsl_m, above_home_m=above_home_m)
        return self.vehicle.events[-1]


@pytest.fixture
def in_flight(vehicle, pennovation):
    return InFlight(vehicle, pennovation.frame, pennovation.home)


def test_heights_count_from_the_home_of_the_take_off(in_flight):
    told = in_flight.reads(529.0, 65.0)  # another station has moved home 25 m down
    assert told.altitude_m == pytest.approx(40.0)
    assert told.home_moved == pytest.approx(HomeMove(0.0, 0.0, -25.0))
    told = in_flight.reads(504.0, 40.0)  # it sinks: PX4 keeps 40 m above the home of now
    assert told.altitude_m == pytest.approx(15.0)
    told = in_flight.reads(529.0, 40.0)
    assert (told.altitude_m, told.home_moved) == (40.0, None)


def test_a_home_moved_aside_is_told(in_flight):
    in_flight.beats_at_home(489.0, east_m=60.0)
    told = in_flight.reads(529.0, 40.0)
    assert told.home_moved == pytest.approx(HomeMove(60.0, 0.0, 0.0), abs=0.1)
    assert told.altitude_m == 40.0


def test_px4_corrects_its_home_by_itself_and_nothing_is_told(in_flight):
    for home_m in (487.9, 490.2, 486.7, 491.3):  # as measured on PX4 1.17, up to 2.3 m
        told = in_flight.reads(home_m + 40.0, 40.0)
        assert (told.altitude_m, told.home_moved) == (40.0, None)


def test_before_take_off_home_is_where_the_autopilot_has_it_and_near_the_vehicle(vehicle):
    vehicle.beats(MISSION)
    vehicle.says("_on_extended_state", landed_state=1)
    for amsl_m, above_home_m, moved in ((489.0, 0.3, None), (492.0, 0.0, None), (492.0, 25.0, -25)):
        vehicle.is_at(399_400_000, -752_000_000, amsl_m=amsl_m, above_home_m=above_home_m)
        told = vehicle.events[-1].home_moved
        assert (None if told is None else told.up_m) == moved


def test_a_repeated_report_of_an_item_is_told_once(vehicle):
    for seq in (3, 3, 3, 4, 4):
        vehicle.says("_on_item_reached", seq=seq)
    assert [e.item for e in vehicle.events if isinstance(e, ItemReached)] == [3, 4]


def test_another_plan_is_told_each_time_and_only_when_guarded(vehicle):
    def current(plan):
        vehicle.says("_on_mission_current", seq=2, total=5, mission_id=plan, fence_id=7)

    current(1)
    current(2)
    vehicle.telemetry.guard_plan()
    for plan in (2, 2, 3, 4):
        current(plan)
    assert [type(e) for e in vehicle.events] == [PlanReplaced, PlanReplaced]


@pytest.mark.parametrize(
    ("plan", "fence", "only_fence"), [(1, 8, True), (2, 7, False), (2, 8, False)]
)
def test_another_fence_is_told_from_another_mission(vehicle, plan, fence, only_fence):
    vehicle.telemetry.guard_plan()
    vehicle.says("_on_mission_current", seq=2, total=5, mission_id=1, fence_id=7)
    vehicle.says("_on_mission_current", seq=2, total=5, mission_id=plan, fence_id=fence)
    (event,) = vehicle.events
    assert event.only_fence is only_fence


def test_why_a_plan_is_refused_is_kept_until_something_else_is_asked(vehicle):
    telemetry = vehicle.telemetry
    event = {"log_levels": 0x33, "arguments": [3, 0, *[0] * 38]}
    vehicle.says("_on_event", id=event_id("navigator_mis_geofence_violation"), **event)
    vehicle.says("_on_event", id=event_id("check_battery_low"), **event)
    assert telemetry.refusals == [
        "plan item 3 lies in a no-fly zone, outside the fence, or beyond GF_MAX_HOR/VER_DIST"
    ]
    assert "plan item 3" in telemetry.said()
    assert "battery" not in telemetry.said()
    telemetry.forget_words()
    assert (telemetry.refusals, telemetry.said()) == ([], "")


def test_a_lost_fix_and_the_target_show_in_telemetry(vehicle, pennovation):
    latitude_deg, longitude_deg = pennovation.frame.to_geodetic(pennovation.home)
    home = round(latitude_deg * 1e7), round(longitude_deg * 1e7)
    vehicle.beats(HOLD)
    vehicle.is_at(*home)
    assert (vehicle.events[-1].fix, vehicle.events[-1].target) == (True, None)
    vehicle.says("_on_gps", fix_type=1, satellites_visible=3, h_acc=0, alt=0, time_usec=0)
    vehicle.says("_on_target", lat_int=home[0], lon_int=home[1])
    vehicle.is_at(*home)
    assert not vehicle.events[-1].fix
    assert vehicle.events[-1].target == pytest.approx(pennovation.home, abs=0.1)
    vehicle.beats(MISSION)
    assert vehicle.events[-1].target is None  # it was the other mode's


def test_the_wind_that_px4_estimates_is_told(vehicle):
    vehicle.beats(MISSION)
    vehicle.is_at(399_400_000, -752_000_000)
    assert vehicle.events[-1].wind_m_s is None
    vehicle.says("_on_wind", wind_x=-3.0, wind_y=4.0)  # MAVLink: x north, y east
    vehicle.is_at(399_400_000, -752_000_000)
    assert vehicle.events[-1].wind_m_s == (4.0, -3.0)
    vehicle.says("_on_wind", wind_x=None, wind_y=None)
    vehicle.is_at(399_400_000, -752_000_000)
    assert vehicle.events[-1].wind_m_s is None


def test_the_receiver_s_altitude_counts_while_it_is_new(vehicle):
    vehicle.beats(MISSION)
    receiver = {"fix_type": 3, "satellites_visible": 12, "alt": 530_500, "time_usec": 1_000_000}
    vehicle.says("_on_gps", **receiver)
    heard = []
    for time_ms in (1000, 2400, 2600):
        vehicle.is_at(399_400_000, -752_000_000, time_ms=time_ms)
        heard.append(vehicle.events[-1].gps_amsl_m)
    assert heard == [530.5, 530.5, None]
    vehicle.says("_on_gps", **receiver | {"fix_type": 1, "time_usec": 2_600_000})
    vehicle.is_at(399_400_000, -752_000_000, time_ms=2600)
    assert vehicle.events[-1].gps_amsl_m is None
