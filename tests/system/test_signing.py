"""Signed MAVLink: through real MAVSDK to a vehicle that obeys nothing else, and to a real PX4."""

import asyncio
import contextlib
import json
import os
import select
import socket
import threading
import time
from functools import partial

import pytest
from pymavlink.dialects.v20 import common as mavlink

from air_router.mission.loading import load_mission
from air_router.sim.ports import free_port
from air_router.vehicle.clock import VehicleClock
from air_router.vehicle.px4 import px4_connection
from air_router.vehicle.px4.mavlink_signing import MavlinkSigner, Verdict, timestamp_of
from air_router.vehicle.px4.px4 import Px4Vehicle
from air_router.vehicle.px4.px4_connection import Px4Connection
from air_router.vehicle.px4.signing_key import SigningKey
from air_router.vehicle.vehicle import MavlinkSpoofed
from sitl.process.px4_install import NoPx4Error, find_px4, named
from sitl.process.px4_process import PortsInUseError, Px4Process, Px4Settings
from sitl.px4sim.state import StartPosition

PROVISIONED_UNIX_S = 1_700_000_000  # PX4 begins with the time at which it got its key
LIMIT_S = 60  # against hangs only


@pytest.fixture
def key(tmp_path):
    path = tmp_path / "uav.key"
    SigningKey.generate().write(path)
    return path


class SigningVehicle:
    """Stands before a simulated PX4, as the signing of PX4 1.18 stands before its commander."""

    def __init__(self, key, vehicle_port, companion_port):
        self.signer = MavlinkSigner(SigningKey.read(key), 1, unix_s=lambda: PROVISIONED_UNIX_S)
        self.unsigned = b""  # what leaves before each datagram, in the vehicle's name
        self._inside, self._outside = (
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2)
        )
        self._inside.bind(("127.0.0.1", vehicle_port))
        self._outside.bind(("127.0.0.1", 0))
        self._companion = ("127.0.0.1", companion_port)
        self._waker, self._woken = socket.socketpair()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def close(self):
        self._waker.send(b"\0")
        self._thread.join()
        for each in (self._inside, self._outside, self._waker, self._woken):
            each.close()

    def _run(self):
        vehicle = None
        while True:
            ready, _, _ = select.select([self._inside, self._outside, self._woken], [], [])
            if self._woken in ready:
                return
            with contextlib.suppress(OSError):  # its port is not open
                if self._inside in ready:
                    data, vehicle = self._inside.recvfrom(65535)
                    if self.unsigned:
                        self._outside.sendto(self.unsigned, self._companion)
                    self._outside.sendto(self.signer.sign(data), self._companion)
                if self._outside in ready:
                    taken = self.signer.received(self._outside.recv(65535))
                    if taken and vehicle is not None:
                        self._inside.sendto(taken, vehicle)


@pytest.fixture
def signing_vehicle(vehicle, udp_port, free_udp_port, key):
    """A simulated PX4 that has the key, and the URL at which it is found."""
    vehicle(speed=8)
    port = free_udp_port()
    standing = SigningVehicle(key, udp_port, port)
    yield standing, f"udpin://127.0.0.1:{port}"
    standing.close()


def test_with_the_key_it_answers_and_takes_a_plan(signing_vehicle, answered, short_mission, key):
    standing, url = signing_vehicle
    arguments = ("preflight", short_mission, "--connect", url, "--no-record", "--json")
    code, out, err = answered(*arguments, "--signing-key", key)
    assert code == 0, (out, err)
    checks = {check["name"]: check for check in json.loads(out)["checks"]}
    assert checks["plan"]["found"].startswith("on board, read back, equal")
    assert set(standing.signer.counts) == {Verdict.GOOD}


@pytest.fixture
def plain_vehicle(vehicle, udp_port):
    """Where a simulated PX4 is found that has no key."""
    vehicle(speed=8)
    return f"udpin://127.0.0.1:{udp_port}"


@pytest.fixture
def impatient(monkeypatch):
    monkeypatch.setattr(px4_connection, "FIND_S", 1.5)


def test_without_the_key_or_with_another_one_the_error_has_the_reason(
    signing_vehicle, answered, short_mission, tmp_path, impatient
):
    _, url = signing_vehicle
    arguments = ("preflight", short_mission, "--connect", url, "--no-record")
    code, out, err = answered(*arguments)
    assert (code, out) == (4, "")
    assert "PX4 has a signing key, and obeys only what is signed with it" in err
    other = tmp_path / "other.key"
    SigningKey.generate().write(other)
    code, out, err = answered(*arguments, "--signing-key", other)
    assert (code, out) == (4, "")
    assert "signed with another key" in err
    assert other.read_text().strip() not in err


def test_a_vehicle_without_a_key_is_not_taken_for_one_that_has_it(
    plain_vehicle, answered, short_mission, key, impatient
):
    arguments = ("--connect", plain_vehicle, "--signing-key", key, "--no-record")
    code, out, err = answered("preflight", short_mission, *arguments)
    assert (code, out) == (4, "")
    assert "MAVLink is received, but it is not signed" in err


def test_unsigned_messages_in_the_vehicles_name_are_ignored_and_reported_once(
    signing_vehicle, short_mission, key
):
    standing, url = signing_vehicle
    stolen = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    landing = mavlink.MAVLink_heartbeat_message(2, 12, 157, 6 << 24 | 4 << 16, 4, 3)
    standing.unsigned = bytes(landing.pack(stolen))

    async def main():
        connection = partial(Px4Connection, key=key)
        uav = Px4Vehicle(load_mission(short_mission), url, VehicleClock(), connection=connection)
        events, reported = [], asyncio.Event()

        def take(event):
            events.append(event)
            if isinstance(event, MavlinkSpoofed):
                reported.set()

        try:
            async with asyncio.timeout(LIMIT_S):
                await uav.connect()
                uav.subscribe(take)
                await reported.wait()
                reported.clear()
                await uav.inspect([])
        finally:
            await uav.close()
        return uav.telemetry.armed, [e for e in events if isinstance(e, MavlinkSpoofed)]

    armed, spoofed = asyncio.run(main())
    assert not armed  # which the forged HEARTBEAT reports
    assert len(spoofed) == 1
    assert spoofed[0].count >= 3


class Station:
    """A ground station on another link of a PX4; it has no key."""

    def __init__(self, instance):
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(LIMIT_S)
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self._to = ("127.0.0.1", 18570 + instance)
        self._vehicle = instance + 1
        self._sender = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)

    def close(self):
        self._socket.close()

    def send(self, message):
        self._socket.sendto(message.pack(self._sender), self._to)

    def command(self, number, *params):
        values = (*params, *(0,) * (7 - len(params)))
        self.send(mavlink.MAVLink_command_long_message(self._vehicle, 1, number, 0, *values))

    def forget(self):
        """What comes from now on was sent from now on, as near as a socket shows."""
        self._socket.setblocking(False)
        with contextlib.suppress(BlockingIOError):
            while True:
                self._socket.recv(65535)
        self._socket.settimeout(LIMIT_S)

    def attack(self):
        """Land now, disarm by force, forget the mission, change how fast it flies."""
        self.forget()
        self.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 6)
        self.command(mavlink.MAV_CMD_NAV_LAND)
        self.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 21196)
        self.send(mavlink.MAVLink_mission_clear_all_message(self._vehicle, 1, 0))
        name = b"MPC_XY_VEL_MAX"
        self.send(mavlink.MAVLink_param_set_message(self._vehicle, 1, name, 1.0, 9))

    def received(self, wanted, heartbeats=3):
        """The first message of a type; None: none came before so many heartbeats of PX4."""
        while heartbeats > 0:
            for message in self._parser.parse_buffer(self._socket.recv(65535)) or []:
                if message.get_type() == wanted:
                    return message
                heartbeats -= message.get_type() == "HEARTBEAT"
        return None

    def version(self):
        """What the autopilot answers to a request of its version; None: nothing."""
        self.forget()
        self.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
        answer = self.received("AUTOPILOT_VERSION")
        return (
            None
            if answer is None
            else (answer.flight_sw_version >> 24, answer.flight_sw_version >> 16 & 255)
        )


def first_free(install, mission, folder):
    """A PX4 with an instance number that nothing else here takes."""
    home = load_mission(mission).frame.origin
    place = StartPosition(home.latitude_deg, home.longitude_deg, 6.7)
    for instance in range(30, 40):
        with contextlib.suppress(PortsInUseError):
            return Px4Process(install, Px4Settings(place, 5.0, instance=instance, folder=folder))
    raise PortsInUseError("instances 30 to 39 run")


@pytest.fixture(params=named(os.environ) or [""], ids=lambda place: place or "PATH")
def real_px4(request, short_mission, tmp_path):
    """Each PX4 that PX4_SITL names: its version, and the URL at which it is found."""
    try:
        install = find_px4(request.param or None)
    except NoPx4Error as error:
        pytest.skip(str(error).splitlines()[0])
    with first_free(install, short_mission, tmp_path / "px4") as px4:
        px4.wait_until_armable()
        port = free_port()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as first:
            first.bind(("127.0.0.1", port))
            first.settimeout(LIMIT_S)
            first.sendto(b"\0", ("127.0.0.1", 14580 + px4.instance))  # it keeps to this partner
            first.recv(65535)
        with contextlib.closing(Station(px4.instance)) as station:
            yield px4, f"udpin://127.0.0.1:{port}", station


@pytest.mark.timeout(400)
def test_a_real_px4_with_the_key_obeys_the_flight_and_no_one_else(
    real_px4, command, answered, short_mission, key
):
    px4, url, station = real_px4
    logs = key.parent / "logs"
    version = station.version()
    if version < (1, 18):
        pytest.skip(f"PX4 {version[0]}.{version[1]} has no signing")
    link = ("--connect", url, "--sysid", px4.instance + 1)

    # It answered the station; with the key it does not.
    code, _, err = answered("signing-key", key, *link)
    assert code == 0, err
    assert "the key leaves in the clear" in err
    assert key.read_text().strip() not in err
    assert station.version() is None
    code, _, err = answered("preflight", short_mission, *link, "--no-record")
    assert code == 4
    assert "PX4 has a signing key" in err

    flight = command(
        *("air-router", "fly", short_mission, *link, "--signing-key", key, "--arm", "--yes"),
        *("--duration", 100, "--json", "--log-dir", logs),
    )
    flight.wait_for("READY -> INIT")
    while flight.process.poll() is None:
        station.attack()
        assert station.received("COMMAND_ACK", heartbeats=1) is None
    code, out = flight.finish()
    assert code == 0, flight.printed[-3000:]
    report = json.loads(out)
    assert report["outcome"] == "done"
    assert report["closest_approach_m"] >= report["clearance_m"]
    assert key.read_text().strip().encode() not in b"".join(
        path.read_bytes() for path in logs.rglob("*") if path.is_file()
    )

    # It forgets the key only by a request that is signed with it.
    station.send(mavlink.MAVLink_setup_signing_message(px4.instance + 1, 1, [0] * 32, 0))
    assert station.version() is None
    code, _, err = answered("signing-key", key, "--remove", *link)
    assert code == 0, err
    assert station.version() == version
    station.attack()
    assert station.received("COMMAND_ACK") is not None  # it has teeth


@pytest.mark.timeout(100)
def test_a_real_px4_that_has_its_key_since_yesterday_goes_by_our_time(
    real_px4, answered, short_mission, key
):
    """As after a restart: it begins with the time at which it got the key."""
    px4, url, station = real_px4
    if station.version() < (1, 18):
        pytest.skip("this PX4 has no signing")
    yesterday = timestamp_of(time.time() - 86_400)
    secret = list(SigningKey.read(key).secret)
    station.send(mavlink.MAVLink_setup_signing_message(px4.instance + 1, 1, secret, yesterday))
    link = ("--connect", url, "--sysid", px4.instance + 1, "--signing-key", key)
    code, out, err = answered("preflight", short_mission, *link, "--no-record", "--json")
    assert code == 0, (out, err)
    assert "not reported" not in out


@pytest.mark.timeout(100)
def test_a_real_px4_without_signing_is_reported_not_to_have_taken_the_key(real_px4, answered, key):
    px4, url, station = real_px4
    if station.version() >= (1, 18):
        pytest.skip("this PX4 signs")
    code, _, err = answered("signing-key", key, "--connect", url, "--sysid", px4.instance + 1)
    assert code == 1
    assert "PX4 has not taken the key: it is older than 1.18" in err
