"""The world's clock waits for who falls behind; the processes are played by the tests."""

import json
import random
import socket
import time

import pytest

from air_router.vehicle.limits import PACE_ALLOWANCE_S
from air_router.vehicle.pace import PaceClient, PaceSource, line
from air_router.vehicle.vehicle import FlightMode, LinkSilent, Telemetry
from geo.frame import Point
from sitl.mavlink.vehicle import STEP_S, MavlinkVehicle, VehicleSettings
from sitl.process import pace as pace_rules
from sitl.process.pace import PATIENCE_S, STALLED_SPEED, STARTING_SPEED, Limit, Pace
from sitl.process.pace_link import FollowedPace, PaceServer
from sitl.process.vehicle import LinkAddresses, Ports, VehicleProcess
from sitl.px4sim.state import StartPosition

HOME = StartPosition(39.94, -75.2, 6.7)
FAST = 100.0
NOWHERE = ("127.0.0.1", 9)


def make_pace(**reached_s):
    pace = Pace(len(reached_s))
    for name, time_s in reached_s.items():
        pace.joined(name)
        pace.reached(name, name, time_s, 0.0)
    return pace


def test_the_world_goes_no_farther_than_a_little_beyond_the_slowest():
    pace = make_pace(team=7.0, titan=5.0)
    assert pace.limit(5.1, 0.0) == Limit(5.0 + PACE_ALLOWANCE_S)
    pace.reached("titan", "titan", 9.0, 0.1)
    assert pace.limit(5.2, 0.1) == Limit(7.0 + PACE_ALLOWANCE_S)


def test_it_goes_slowly_until_all_who_are_expected_have_reported_how_far_they_are():
    pace = Pace(2)
    pace.joined("team")
    pace.joined("titan")
    assert pace.limit(0.0, 0.0) == Limit(most_speed=STARTING_SPEED)
    pace.reached("team", "team", 1.0, 0.0)
    assert pace.limit(1.0, 0.0) == Limit(1.0 + PACE_ALLOWANCE_S, STARTING_SPEED)
    pace.reached("titan", "titan", 1.0, 0.0)
    assert pace.limit(1.0, 0.0) == Limit(1.0 + PACE_ALLOWANCE_S)


def test_one_that_is_killed_is_waited_for_no_more_also_before_it_reported_anything():
    pace = make_pace(team=7.0, titan=5.0)
    pace.left("titan")
    assert pace.limit(5.2, 0.0) == Limit(7.0 + PACE_ALLOWANCE_S)
    pace.left("team")
    assert pace.limit(7.2, 0.0) == Limit()
    early = Pace(1)
    early.joined("team")
    early.left("team")
    assert early.limit(0.0, 0.0) == Limit()


def test_one_that_is_stopped_holds_the_world_for_some_seconds_then_it_is_real_time():
    pace = make_pace(team=5.0, titan=5.0)
    held = 5.0 + PACE_ALLOWANCE_S
    pace.reached("team", "team", held, 0.0)
    assert pace.limit(held, 10.0) == Limit(held)
    assert pace.limit(held, 10.0 + PATIENCE_S) == Limit(held)
    assert pace.limit(held, 10.1 + PATIENCE_S) == Limit(held + PACE_ALLOWANCE_S, STALLED_SPEED)
    pace.reached("titan", "titan", 6.0, 20.0)
    assert pace.limit(held, 20.0) == Limit(held + PACE_ALLOWANCE_S)


@pytest.mark.parametrize("loss", [0.0, 0.2, 0.5, 1.0])
def test_what_a_link_loses_holds_nothing(loss):
    """Ten positions a second to a process that answers each at once; a minute at five times."""
    rng, pace, received_s = random.Random(1), make_pace(titan=0.0), 0.0
    time_s = wall_s = 0.0
    while time_s < 60.0:
        limit = pace.limit(time_s, wall_s, received_s)
        wall_s += STEP_S / min(limit.most_speed, 5.0)
        if time_s >= limit.until_s:
            continue  # it is stopped, and sends nothing
        stamp_s, time_s = time_s, round(time_s + STEP_S, 2)
        if round(stamp_s * 100) % 10 == 0 and rng.random() >= loss:
            received_s = stamp_s
            pace.reached("titan", "titan", stamp_s, wall_s)
    assert wall_s == pytest.approx(60.0 / 5.0, rel=0.02)
    assert pace.as_json(5.0)["processes"]["titan"]["lost_s"] is None


def test_one_that_has_more_to_work_through_is_waited_for_whatever_was_lost():
    pace = make_pace(titan=5.0)
    assert pace.limit(5.3, 0.0, received_s=5.1) == Limit(5.0 + PACE_ALLOWANCE_S)
    pace.reached("titan", "titan", 5.1, 0.1)
    assert pace.limit(5.3, 0.1, received_s=5.1) == Limit()


def test_one_that_reports_the_same_again_and_again_holds_no_longer_and_is_reported_lost():
    pace = make_pace(titan=5.0)
    for tenth in range(21):
        assert pace.limit(5.2, tenth / 10) == Limit(5.0 + PACE_ALLOWANCE_S)
        pace.reached("titan", "titan", 5.0, tenth / 10)
    assert pace.limit(5.2, 2.1) == Limit(most_speed=STALLED_SPEED)
    assert pace.as_json(5.0)["processes"]["titan"]["lost_s"] == 5.2


def test_the_rate_that_was_kept_and_who_was_behind_are_reported():
    pace = make_pace(team=5.0, titan=5.0)
    pace.limit(5.0, 100.0)
    pace.reached("team", "team", 5.2, 100.02)
    pace.limit(5.2, 100.02)
    pace.reached("titan", "titan", 5.1, 101.02)
    pace.limit(25.0, 105.0)
    report = pace.as_json(10.0)
    assert (report["requested"], report["kept"]) == (10.0, 4.0)
    assert report["processes"] == {
        "team": {"behind_s": 0.0, "waited_s": 0.0, "lost_s": None},
        "titan": {"behind_s": pytest.approx(0.1), "waited_s": 1.0, "lost_s": None},
    }
    assert Pace().as_json(3.0) == {"requested": 3.0, "kept": None, "processes": {}}


@pytest.fixture
def patient(monkeypatch):
    """However busy this machine is, no process counts as stopped."""
    monkeypatch.setattr(pace_rules, "PATIENCE_S", 1e9)


@pytest.fixture
def make_vehicle():
    processes = []

    def make(pace, speed=FAST, partner=NOWHERE):
        ports = Ports(LinkAddresses(("", 0), partner), None, LinkAddresses(("", 0), NOWHERE))
        settings = VehicleSettings(HOME, speed=speed, ground_link=False)
        processes.append(VehicleProcess(settings, ports, pace))
        return processes[-1]

    yield make
    for process in processes:
        process.close()


def run_until(process, condition, also=lambda: None):
    def stopped():
        also()
        return condition()

    process.run(stopped)


def time_s(process):
    return process.vehicle.autopilot.time_s


def source_of(server):
    return PaceSource("127.0.0.1", server.port, FAST)


@pytest.mark.usefixtures("patient")
def test_a_vehicle_stands_still_for_a_process_that_works_and_flies_on_when_it_is_gone(make_vehicle):
    server = PaceServer(("127.0.0.1", 0), 1)
    process = make_vehicle(server)
    client = PaceClient(source_of(server), "titan")
    for reached_s in (1.0, 4.0):
        client.reached(reached_s)
        run_until(
            process, lambda at_s=reached_s: time_s(process) > at_s + PACE_ALLOWANCE_S - STEP_S
        )
        looks = iter(range(5))
        run_until(process, lambda looks=looks: next(looks, None) is None)
        assert time_s(process) < reached_s + PACE_ALLOWANCE_S + STEP_S
    client.close()
    run_until(process, lambda: time_s(process) > 10.0)
    report = process.pace()
    assert report["requested"] == FAST
    assert 0 < report["kept"] <= FAST
    assert report["processes"]["titan"]["waited_s"] > 0


def test_a_vehicle_that_cannot_keep_to_its_speed_listens(make_vehicle, monkeypatch):
    received, step = [], MavlinkVehicle.step
    monkeypatch.setattr(MavlinkVehicle, "step", lambda it: (time.sleep(2 * STEP_S), step(it)))
    monkeypatch.setattr(MavlinkVehicle, "receive", lambda _, _link, data: received.append(data))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as partner:
        partner.bind(("127.0.0.1", 0))
        process = make_vehicle(None, speed=1.0, partner=partner.getsockname())
        partner.sendto(b"an order", ("127.0.0.1", process.port(process.vehicle.onboard)))
        run_until(process, lambda: received or time_s(process) > 20 * STEP_S)
    assert received == [b"an order"]


@pytest.mark.usefixtures("patient")
def test_two_vehicles_keep_together(make_vehicle):
    """One sets the pace for the other, which is waited for as well."""
    server = PaceServer(("127.0.0.1", 0), 2)
    first = make_vehicle(server)
    second = make_vehicle(FollowedPace(source_of(server), "vehicle 2"))
    team = PaceClient(source_of(server), "team")
    apart_s = []

    def turn():
        """One turn of the second's loop, and of the team, in each turn of the first's."""
        looks = iter(range(1))
        run_until(second, lambda: next(looks, None) is None)
        team.reached(time_s(first))
        apart_s.append(abs(time_s(first) - time_s(second)))

    run_until(first, lambda: time_s(first) > 5.0, turn)
    assert max(apart_s) <= PACE_ALLOWANCE_S + 2 * STEP_S
    team.close()
    server.close()  # left alone the second one flies on by itself
    run_until(second, lambda: time_s(second) > 8.0)


@pytest.mark.parametrize(
    "data",
    [
        b"GET / HTTP/1.1\r\n\r\n",
        line({"reached_s": 1}),
        b'{"name": "x", "reached_s": NaN}\n',
        b'{"name": "x", "reached_s": 1%s}\n' % (b"0" * 400),
        b'{"name": "x", "reached_s": %s\n' % (b"[" * 980),
        line({"name": "x" * 2000, "reached_s": 1}),
    ],
)
def test_an_intruder_is_hung_up_on_and_no_program_waits_for_it(data):
    with PaceServer(("127.0.0.1", 0), 0) as server:
        intruder = socket.create_connection(("127.0.0.1", server.port))
        intruder.sendall(data)
        while len(server.sockets) < 2:
            server.attend(server.sockets)
        while len(server.sockets) > 1:
            server.attend(server.sockets)
        assert intruder.recv(100) == b""
        intruder.close()
        assert server.limit(100.0, 0.0) == Limit()


def test_a_connection_reports_one_name():
    with (
        PaceServer(("127.0.0.1", 0), 0) as server,
        socket.create_connection(("127.0.0.1", server.port)) as client,
    ):
        for name in ("titan", "titan", "io"):
            client.sendall(line({"name": name, "reached_s": 1.0}))
            while not server.attend(server.sockets):
                pass
        assert client.recv(100) == b""
        assert set(server.as_json(1.0)["processes"]) == {"titan"}


def test_a_follower_that_does_not_read_is_left_before_it_gets_half_a_line():
    with (
        PaceServer(("127.0.0.1", 0), 1) as server,
        socket.create_connection(("127.0.0.1", server.port)) as follower,
    ):
        follower.sendall(line({"name": "vehicle 2", "reached_s": 1e9, "follows": True}))
        while not server.attend(server.sockets):
            pass
        for step in range(1_000_000):
            server.limit(step / 100, 0.0)
            if len(server.sockets) == 1:
                break
        assert len(server.sockets) == 1
        with follower.makefile("rb") as lines:
            *whole, _ = lines
        assert all("until_s" in json.loads(each) for each in whole)


@pytest.mark.parametrize(
    "data",
    [
        b"SSH-2.0-OpenSSH\r\n",
        b"x" * 2000,
        line({"until_s": 1.0}),
        b'{"until_s": NaN, "most_speed": 1}\n',
        b'{"until_s": 1%s, "most_speed": 1}\n' % (b"0" * 400),
        b'{"until_s": %s\n' % (b"[" * 980),
    ],
)
def test_a_vehicle_does_not_follow_what_sets_no_pace(data):
    with socket.create_server(("127.0.0.1", 0)) as server:
        pace = FollowedPace(PaceSource("127.0.0.1", server.getsockname()[1]), "vehicle 2")
        pace.limit(0.0, 0.0)
        other, _ = server.accept()
        with other:
            other.sendall(data)
            while pace.sockets:
                pace.attend(pace.sockets)
    assert pace.limit(100.0, 0.0) == Limit()


def test_without_a_world_to_report_to_and_after_it_has_ended_nothing_happens():
    PaceClient(None, "titan").reached(1.0)
    with socket.create_server(("127.0.0.1", 0)) as server:
        client = PaceClient(PaceSource("127.0.0.1", server.getsockname()[1]), "titan")
        client.reached(1.0)
        connection, _ = server.accept()
        with connection:
            assert json.loads(connection.recv(100)) == {"name": "titan", "reached_s": 1.0}
    for step in range(100):
        client.reached(2.0 + step)
    client.close()


@pytest.mark.parametrize(
    "text", ["24900", "localhost", "h:0", "h:1,0", "h:1,fast", ":1", "h:99999"]
)
def test_what_is_no_place_of_a_pace_is_refused(text):
    with pytest.raises(ValueError, match="is not HOST:PORT"):
        PaceSource.of(text)


def test_a_companion_is_waited_for_from_arming_to_the_end():
    with socket.create_server(("127.0.0.1", 0)) as server:
        source = PaceSource("127.0.0.1", server.getsockname()[1])
        with PaceClient(source, "titan") as client:
            for time_s, armed in ((1.0, False), (2.0, True), (3.0, True), (4.0, False)):
                client.received(LinkSilent(time_s, 3.0))
                client.received(telemetry(time_s, armed=armed))
        connection, _ = server.accept()
        with connection, connection.makefile() as lines:
            assert [json.loads(text)["reached_s"] for text in lines] == [2.0, 3.0, 4.0]


def telemetry(time_s, *, armed):
    return Telemetry(
        time_s=time_s,
        position=Point(0.0, 0.0),
        altitude_m=0.0,
        velocity_m_s=(0.0, 0.0),
        heading_deg=None,
        armed=armed,
        in_air=armed,
        mode=FlightMode.HOLD,
        failsafe=False,
        battery=None,
        item=None,
    )


def test_a_place_of_a_pace_is_written_as_it_is_read():
    source = PaceSource("127.0.0.1", 24900, 12.5)
    assert PaceSource.of(str(source)) == source
    assert PaceSource.of("localhost:1") == PaceSource("localhost", 1)
