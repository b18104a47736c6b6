"""Faults that were found in commit c597b59, each as it is seen from outside.

With CHECKOUT_UNDER_TEST=DIR the programs of that checkout are started instead of ours: all of this
fails on c597b59. The whole list is docs/evidence/faults-of-c597b59.csv.
"""

import contextlib
import os
import re
import resource
import socket
import time

import pytest
from pymavlink.dialects.v20 import common as mavlink

from air_router.control.control import ControlClient
from air_router.sim.ports import free_port
from mocha_link import Team
from mocha_link.service.service_client import ServiceClient
from sitl.px4sim.state import FlightMode
from sitl.rehearsal.fakes.link import StreamFault
from sitl.rehearsal.programs.relay import Weather, wait_until
from tests.air_router.record.test_replay import chunks_of
from tests.stray_post import post
from tests.system.conftest import LIMIT_S, ROOT, UNDER_TEST, commands
from tests.system.operated import Operated, draw_zone
from tests.system.test_hostile_flight import without_relays

pytestmark = pytest.mark.patient

CORNER = "39.9419367"
HOLD = FlightMode.AUTO_LOITER.custom_mode
POSITIONS = "LOCAL_POSITION_NED", "GLOBAL_POSITION_INT"
ORDERS = {mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_CMD_DO_REPOSITION}


def zones_of(folder, text):
    (folder / "zones.geojson").write_text(text)
    return f"no_fly_files: [{folder / 'zones.geojson'}]\n"


def flawed_zones():
    ring = '{"type": "Polygon", "coordinates": [[[-75.2, 39.94], ["x", 39.95]]]}'
    feature = f'{{"type": "Feature", "properties": {{}}, "geometry": {ring}}}'
    return f'{{"type": "FeatureCollection", "features": [{", ".join([feature] * 2000)}]}}'


@pytest.mark.parametrize(
    ("flaw", "message"),
    [
        (lambda text, _: text.replace(CORNER, "1e308"), "not-on-earth"),
        (lambda text, _: text.replace(CORNER, "9" * 400), "wrong-value"),
        (lambda *_: "[" * 100_000, "too-deep"),
        (lambda text, folder: text + zones_of(folder, flawed_zones()), "1980 more problems"),
    ],
    ids=["1e308", "400 digits", "deep", "thousands of problems"],
)
def test_whatever_a_file_holds_it_costs_a_screen_of_errors(answered, short_mission, flaw, message):
    text = short_mission.read_text(encoding="utf-8")
    short_mission.write_text(flaw(text, short_mission.parent), encoding="utf-8")
    code, _, err = answered("check", short_mission)
    assert code == 3, err[-500:]
    assert message in err
    assert len(err) < 5_000


@pytest.fixture(scope="module")
def edit_page(shared_command, shared_mission):
    """The port of a page that requires a token, of a process that may open 200 files."""
    page = shared_command(
        *("air-router", "edit", shared_mission, "--no-open", "--port=0", "--host=0.0.0.0")
    )
    address = page.process.stdout.readline().decode()
    resource.prlimit(page.process.pid, resource.RLIMIT_NOFILE, (200, 200))
    return int(re.search(r":(\d+)/", address)[1])


def status_of(port, cookie=b"", at="127.0.0.1"):
    """What the page answers to a request."""
    with socket.create_connection(("127.0.0.1", port), 10, source_address=(at, 0)) as client:
        client.sendall(b"GET / HTTP/1.1\r\nHost: 127.0.0.1:%d\r\n" % port)
        client.sendall(b"Cookie: air_router_%d=%b\r\n\r\n" % (port, cookie))
        return client.recv(4096).split()[1]


def test_a_cookie_that_is_no_text_is_no_fault_of_the_server(edit_page):
    assert status_of(edit_page, b"\xff") == b"401"


def test_connections_that_are_left_open_cost_the_others_nothing(edit_page):
    with contextlib.ExitStack() as stack:
        for _ in range(250):
            half = stack.enter_context(socket.socket())
            half.settimeout(2.0)
            with contextlib.suppress(OSError):
                half.connect(("127.0.0.1", edit_page))
                half.sendall(b"GET / HTTP/1.1\r\nHost: ")
        assert status_of(edit_page, at="127.0.0.2") == b"401"


def answer_to_a_page(port, request, limit_s=5.0):
    """What a web page that posts a request to that port gets to read."""
    received = b""
    with socket.create_connection(("127.0.0.1", port)) as page:
        page.settimeout(limit_s)
        page.sendall(post(port, request))
        with contextlib.suppress(OSError):
            while b"{" not in received and (piece := page.recv(4096)):
                received += piece
    return received


@pytest.fixture
def node(command, short_mission, tmp_path):
    """Starts the node of a robot, and waits until it runs."""
    team = short_mission.with_name("team.yaml")
    without_relays(team)

    def start(*options):
        started = command("mocha-link", "node", team, "--robot=io", *options)
        started.wait_for("ready")
        return started

    return start


def test_what_is_installed_is_checked_and_what_is_shipped_is_listed():
    pins = (UNDER_TEST / "constraints.txt").read_text(encoding="utf-8").replace("\\\n", "")
    pinned = [line for line in pins.splitlines() if "==" in line]
    assert pinned
    assert all("--hash=sha256:" in line for line in pinned)
    assert "://" not in pins
    assert "sbom" in (UNDER_TEST / "Makefile").read_text(encoding="utf-8")


def test_a_web_page_gets_no_answer_from_a_node(node):
    port = free_port(socket.SOCK_STREAM)
    node(f"--serve=tcp://127.0.0.1:{port}")
    assert b"{" not in answer_to_a_page(port, b'{"request":"team","id":1}')


def test_a_damaged_database_is_set_aside_and_one_that_is_deleted_is_begun_anew(node, tmp_path):
    path, endpoint = tmp_path / "io.db", f"ipc://{tmp_path}/node"
    first = node(f"--storage={path}", f"--serve={endpoint}")
    with ServiceClient(endpoint, timeout_s=20.0) as client:
        topic = next(iter(Team.load(tmp_path / "mission" / "team.yaml").topics_of("io"))).name
        for number in range(40):
            client.publish(topic, b"message %d " % number * 100)
    first.interrupt()
    first.finish()
    os.truncate(path, path.stat().st_size // 8192 * 4096)
    spoilt = path.read_bytes()
    node(f"--storage={path}", f"--serve={endpoint}")

    def is_written():
        with ServiceClient(endpoint, timeout_s=20.0) as client:
            client.publish(topic, b"and on")
        return path.exists() and path.stat().st_size > 0

    assert wait_until(is_written, LIMIT_S)
    assert any(p.read_bytes() == spoilt for p in tmp_path.glob("io.db.*"))
    for file in (path, *tmp_path.glob("io.db-*")):
        file.unlink()
    assert wait_until(is_written, LIMIT_S)


def test_a_port_of_px4_that_is_taken_is_one_error_and_no_departure(answered, tmp_path):
    build = tmp_path / "build" / "px4_sitl_default"
    for name, text in (("bin/px4", "#!/bin/sh\nexec sleep 60\n"), ("etc/init.d-posix/rcS", "")):
        path = build / name
        path.parent.mkdir(parents=True)
        path.write_text(text)
        path.chmod(0o755)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        with contextlib.suppress(OSError):  # another program has it
            station.bind(("127.0.0.1", 14550))
        code, out, err = answered("conform", "arm-twice", "--px4", tmp_path, of="sitl")
    assert (code, out) == (4, "")
    assert err.count("\n") == 1
    assert "cannot listen on UDP port 14550" in err


def test_a_reload_before_the_vehicle_is_received_waits_for_it(command, tmp_path):
    with Operated(command, tmp_path) as flight:
        flight.type("reload")
        flight.program.wait_for("not reloaded")
        draw_zone(flight.mission)
        flight.type("reload")
        code, _ = flight.program.finish()
    assert "zones changed: 'drawn' is new" in flight.program.printed
    assert "nothing received within 5 s" in flight.program.printed
    assert code == 4
    assert "Traceback" not in flight.program.printed


@pytest.fixture(scope="class")
def ready(tmp_path_factory):
    """A flight that gets ready over a slow link, for the tests of this class, and its control."""
    control, folder = free_port(socket.SOCK_STREAM), tmp_path_factory.mktemp("ready")
    slow = Weather(streams={"": StreamFault.LATE}, late_s=0.01)
    control_at, options = [f"--control={control}"], {"speed": 2, "weather": slow}
    with commands(folder) as start, Operated(start, folder, *control_at, **options) as flight:
        yield flight, control


class TestBeforeItsPilotFlies:
    def test_a_reload_during_the_upload_goes_on_board_after_it(self, ready):
        flight, _ = ready
        (first,) = flight.wait_for("MISSION_COUNT", mission_type=1)
        draw_zone(flight.mission)
        flight.type("reload")
        flight.program.wait_for("waiting for the pilot")
        flight.program.wait_for("the changed fence is on board")
        flight.relay.weather = Weather()
        flight.relay.station().send("MISSION_REQUEST_LIST", mission_type=1)

        def counts():
            return [m.fields["count"] for m in flight.passed("MISSION_COUNT") if m.target == 255]

        assert wait_until(counts, LIMIT_S)
        assert counts() == [first.fields["count"] + 1]

    def test_a_web_page_gets_no_answer_from_a_flight(self, ready):
        flight, control = ready
        flight.program.wait_for("waiting for the pilot")
        assert b"{" not in answer_to_a_page(control, b'{"request":"status","id":1}')

    def test_a_record_goes_on_when_the_disk_has_room_again(self, ready):
        flight, _ = ready
        flight.program.wait_for("waiting for the pilot")
        (path,) = flight.logs.glob("*.mcap")
        process = flight.program.process.pid
        _, most = resource.prlimit(process, resource.RLIMIT_FSIZE)
        resource.prlimit(process, resource.RLIMIT_FSIZE, (path.stat().st_size, most))
        flight.program.wait_for(str(path.name) + ": ")
        resource.prlimit(process, resource.RLIMIT_FSIZE, (most, most))
        full = path.stat().st_size
        assert wait_until(lambda: path.stat().st_size > full + 10_000, LIMIT_S)


LATE_MODE = Weather(streams={"HEARTBEAT": StreamFault.LATE}, late_s=1.0)


def test_a_disarming_right_after_the_arming_is_not_overridden(command, tmp_path):
    with Operated(command, tmp_path, "--arm", "--yes", speed=5, weather=LATE_MODE) as flight:
        flight.wait_for("COMMAND_ACK", command=mavlink.MAV_CMD_COMPONENT_ARM_DISARM)
        flight.relay.station().disarm(forced=False)
        wait_until(lambda: flight.program.process.poll() is not None, 15.0)
        flight.program.process.kill()
        orders = flight.passed("COMMAND_LONG", command=mavlink.MAV_CMD_COMPONENT_ARM_DISARM)
        assert [m.fields["param1"] for m in orders] == [1.0, 0.0]


def test_a_mode_that_the_pilot_chose_right_after_the_arming_is_not_taken_back(command, tmp_path):
    with Operated(command, tmp_path, "--arm", "--yes", speed=5, weather=LATE_MODE) as flight:
        flight.wait_for("COMMAND_ACK", command=mavlink.MAV_CMD_COMPONENT_ARM_DISARM)
        flight.relay.station().choose(FlightMode.AUTO_RTL)
        wait_until(lambda: flight.program.process.poll() is not None, 15.0)
        flight.program.process.kill()
        chosen = flight.passed("COMMAND_LONG", command=mavlink.MAV_CMD_DO_SET_MODE, param3=4.0)
        assert chosen == []


@contextlib.contextmanager
def flying(start, folder):
    """A flight that climbs, and a client of its control endpoint."""
    control = f"ipc://{folder}/control"
    options = "--arm", "--yes", f"--control={control}"
    with (
        Operated(start, folder, *options, speed=4) as flight,
        ControlClient(control, timeout_s=30) as uav,
    ):
        flight.program.wait_for("READY -> INIT")
        yield flight, uav


@pytest.fixture(scope="module" if UNDER_TEST == ROOT else "function")
def flown(shared_command, tmp_path_factory):
    """One flight for several tests; a program that fails in one of them has one for each."""
    with flying(shared_command, tmp_path_factory.mktemp("flown")) as both:
        yield both


def test_a_hold_does_not_wait_for_a_go_to_that_was_lost(flown):
    flight, uav = flown
    assert uav.hold().accepted
    assert wait_until(lambda: flight.relay.recording.mode == HOLD, LIMIT_S)
    flight.relay.weather = Weather(commands=frozenset({mavlink.MAV_CMD_DO_REPOSITION}))
    assert uav.goto([(39.9423, -75.1999)]).accepted
    lost = flight.wait_for("COMMAND_INT", command=mavlink.MAV_CMD_DO_REPOSITION)[-1]
    flight.relay.weather = Weather()
    before, requested_s = len(flight.relay.recording.messages), time.monotonic()
    assert uav.hold().accepted

    def holds():
        return any(
            message.component == lost.component
            and message.fields.get("command") in ORDERS
            and message.fields.get("x") != lost.fields["x"]
            for message in flight.relay.recording.messages[before:]
        )

    assert wait_until(holds, LIMIT_S)
    assert time.monotonic() - requested_s < 1.5  # 0.1 s, but for a busy machine


def refusals(printed):
    """How many there were; an older program does not know `resume upload`."""
    return printed.count(": refused: ") + printed.count("'resume' stands alone")


def take_it_back(flight, uav):
    """What an operator can request after a takeover; one of it leads on."""
    assert wait_until(lambda: not uav.status()["in_charge"], LIMIT_S)
    flight.relay.station().choose(FlightMode.AUTO_LOITER)
    assert wait_until(lambda: uav.status()["mode"] == "Hold", LIMIT_S)
    for line in ("resume", "resume upload", "home"):
        flight.program.read()
        before = refusals(flight.program.printed)
        flight.type(line)
        flight.program.wait_until(
            lambda printed, before=before: refusals(printed) > before or uav.status()["in_charge"],
            f"what becomes of {line}",
        )
        if uav.status()["in_charge"]:
            return True
    return False


def test_a_flight_whose_fence_a_station_deleted_can_be_gone_on_with(flown):
    flight, uav = flown
    flight.relay.station().send("MISSION_CLEAR_ALL", mission_type=1)
    assert take_it_back(flight, uav), flight.program.printed


def test_a_flight_that_was_taken_lower_can_be_gone_on_with(flown):
    flight, uav = flown
    seen, station = flight.relay.recording, flight.relay.station()
    high_m = seen.above_m

    def is_lower():
        """A command of ours that had left before may undo the first choice."""
        if seen.mode != FlightMode.AUTO_LAND.custom_mode:
            station.choose(FlightMode.AUTO_LAND)
        return seen.above_m < high_m - 6.0

    assert wait_until(is_lower, LIMIT_S), flight.program.printed
    assert take_it_back(flight, uav), flight.program.printed


def test_home_without_positions_announces_what_it_waits_for(flown):
    flight, uav = flown
    flight.relay.weather = Weather(streams=dict.fromkeys(POSITIONS, StreamFault.LOST))
    seen = flight.relay.recording
    before, since_s = len(seen.messages), seen.time_s

    def noticed():
        """It comes home by itself after 30 s; unnoticed, it gets the request after 12."""
        texts = [m.fields["text"] for m in seen.messages[before:] if m.name == "STATUSTEXT"]
        return (
            any("position not received" in text for text in texts) or seen.time_s > since_s + 12.0
        )

    assert wait_until(noticed, LIMIT_S)
    assert "as soon as its position is known" in uav.home().why


def test_a_damaged_record_does_not_replay_as_the_same(flown, answered):
    flight, _ = flown
    flight.program.interrupt()
    flight.program.finish()
    (path,) = flight.logs.glob("*.mcap")
    data = bytearray(path.read_bytes())
    chunks = [*chunks_of(data)]
    start, length = chunks[len(chunks) // 2]
    middle = start + length // 2
    data[middle : middle + 40] = bytes(40)
    path.write_bytes(data)
    code, out, err = answered("replay", path)
    assert code == 3, out + err
    assert "damaged" in out + err
