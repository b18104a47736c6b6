"""A short flight of `sitl vehicle` through the real MAVSDK, faster than life."""

import contextlib
import json
import math
import socket
import subprocess
import sys
import threading

import pytest
from mavsdk.component_type import ComponentType
from mavsdk.logging import log_subscribe
from mavsdk.mavsdk import Configuration, Mavsdk
from mavsdk.plugins.action.action import Action, ActionError
from mavsdk.plugins.mavlink_direct.mavlink_direct import MavlinkDirect
from mavsdk.plugins.mission_raw.mission_raw import MissionItem, MissionRaw
from mavsdk.plugins.param.param import Param
from mavsdk.plugins.telemetry.telemetry import Telemetry

from sitl.px4sim.motion.projection import MapProjection

HOME = (47.397742, 8.545594, 489.4)
SPEED = 8  # MAVSDK repeats by the clock on the wall: the vehicle must keep up on a busy machine
LIMIT_S = 200
LOITER, TAKEOFF, MISSION, RTL = 3 << 24, 2 << 24, 4 << 24, 5 << 24
AUTO = 4 << 16


def free_udp_port():
    with contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class Companion:
    """MAVSDK as a companion computer, with the newest message of every kind."""

    def __init__(self, port):
        log_subscribe(lambda *_: True)  # keeps MAVSDK's log off stdout
        configuration = Configuration.create_with_component_type(ComponentType.COMPANION_COMPUTER)
        configuration.system_id = 1
        configuration.component_id = 191
        self.mavsdk = Mavsdk(configuration)
        self.mavsdk.add_any_connection(f"udpin://127.0.0.1:{port}")
        self._changed = threading.Condition()
        self.last = {}
        self.reached = []
        self.texts = []

    def connect(self):
        self.system = self.mavsdk.first_autopilot(LIMIT_S)
        assert self.system is not None
        self.direct = MavlinkDirect(self.system)
        for name in (
            "HEARTBEAT",
            "CURRENT_MODE",
            "MISSION_CURRENT",
            "MISSION_ITEM_REACHED",
            "GLOBAL_POSITION_INT",
            "HOME_POSITION",
            "EXTENDED_SYS_STATE",
            "SYSTEM_TIME",
            "STATUSTEXT",
        ):
            self.direct.subscribe_message(name, self._on_message)
        self.action = Action(self.system)
        self.raw = MissionRaw(self.system)
        self.telemetry = Telemetry(self.system)
        self.param = Param(self.system)

    def close(self):
        self.mavsdk.destroy()

    def wait(self, condition):
        with self._changed:
            assert self._changed.wait_for(condition, LIMIT_S), self.last

    def _on_message(self, message, _):
        if message.component_id != 1:
            return
        fields = json.loads(message.fields_json)
        with self._changed:
            self.last[message.message_name] = fields
            if message.message_name == "MISSION_ITEM_REACHED":
                self.reached.append(fields["seq"])
            if message.message_name == "STATUSTEXT":
                self.texts.append(fields["text"])
            self._changed.notify_all()

    def value(self, name, field):
        return self.last.get(name, {}).get(field)

    def mode(self):
        return self.value("HEARTBEAT", "custom_mode")

    def armed(self):
        return bool(self.value("HEARTBEAT", "base_mode") & 128)

    def item(self):
        return self.value("MISSION_CURRENT", "seq")

    def away_m(self, north_m, east_m):
        position = self.last["GLOBAL_POSITION_INT"]
        here = MapProjection(*HOME[:2]).to_local(position["lat"] / 1e7, position["lon"] / 1e7)
        return math.dist(here, (north_m, east_m))


@pytest.fixture
def companion():
    port = free_udp_port()
    client = Companion(port)
    command = [sys.executable, "-m", "sitl", "vehicle", "--no-gcs", "--speed", str(SPEED)]
    command += ["--home", ",".join(map(str, HOME)), "--api-to", f"127.0.0.1:{port}"]
    command += ["--truth-to", f"127.0.0.1:{free_udp_port()}", "--epoch", "1700000000"]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        try:
            ready = json.loads(process.stdout.readline())
            assert ready["ready"]
            assert ready["mavlink"] == f"udpin://127.0.0.1:{port}"
            client.connect()
            yield client
        finally:
            client.close()
            process.terminate()
            assert process.wait(LIMIT_S) == 0


def item(sequence, place, command=16, **changes):
    north_m, east_m, up_m = place
    latitude, longitude = MapProjection(*HOME[:2]).to_global(north_m, east_m)
    fields = {
        "seq": sequence,
        "frame": 6,
        "command": command,
        "current": int(sequence == 0),
        "autocontinue": 0,
        "param1": 0.0,
        "param2": 0.0,
        "param3": 0.0,
        "param4": math.nan,
        "x": round(latitude * 1e7),
        "y": round(longitude * 1e7),
        "z": float(up_m),
        "mission_type": 0,
    }
    return MissionItem(**fields | changes)


def vertex(sequence, place, count):
    changes = {"frame": 0, "current": 0, "param1": float(count), "param4": 0.0, "mission_type": 1}
    return item(sequence, (*place, 0), 5002, **changes)


def same(one, other):
    fields = ("seq", "frame", "command", "current", "autocontinue", "param1", "x", "y", "z")
    return all(getattr(one, name) == getattr(other, name) for name in fields)


def test_a_mission_by_jumps(companion):
    flown = [
        item(0, (0, 0, 15), 22, autocontinue=1),
        item(1, (40, 0, 15)),
        item(2, (40, 40, 20)),
        item(3, (0, 40, 15)),
    ]
    corners = [(10, 60), (10, 80), (30, 80), (30, 60)]
    fence = [vertex(number, corner, 4) for number, corner in enumerate(corners)]
    companion.wait(lambda: "GLOBAL_POSITION_INT" in companion.last)
    companion.raw.upload_geofence(fence)
    companion.raw.upload_mission(flown)
    assert all(map(same, companion.raw.download_mission(), flown))
    downloaded = companion.raw.download_geofence()
    assert [(point.x, point.y) for point in downloaded] == [(point.x, point.y) for point in fence]
    companion.wait(lambda: companion.value("MISSION_CURRENT", "mission_state") == 2)
    assert companion.value("MISSION_CURRENT", "fence_id") != 0

    assert companion.param.get_param_float("NAV_ACC_RAD") == 2.0
    assert companion.param.get_param_int("GF_ACTION") == 2
    companion.param.set_param_float("MIS_TAKEOFF_ALT", 12.0)
    assert companion.param.get_param_float("MIS_TAKEOFF_ALT") == 12.0

    companion.wait(lambda: companion.value("HEARTBEAT", "system_status") == 3)
    health = companion.telemetry.health()
    assert health.is_armable
    assert health.is_global_position_ok
    assert health.is_home_position_ok

    companion.action.arm()
    companion.raw.start_mission()
    companion.wait(lambda: companion.mode() == AUTO | MISSION and companion.armed())
    companion.wait(lambda: companion.item() == 1)
    companion.wait(lambda: companion.reached[-1:] == [1])
    assert companion.away_m(40, 0) < 4

    companion.raw.set_current_mission_item(3)
    companion.wait(lambda: companion.item() == 3)
    companion.raw.set_current_mission_item(2)  # in mid-leg
    companion.wait(lambda: companion.reached[-1:] == [2])
    assert companion.away_m(40, 40) < 4
    assert companion.mode() == AUTO | MISSION

    latitude, longitude = MapProjection(*HOME[:2]).to_global(20, 20)
    companion.action.goto_location(latitude, longitude, HOME[2] + 18, math.nan)
    companion.wait(lambda: companion.mode() == AUTO | LOITER)
    companion.wait(lambda: companion.away_m(20, 20) < 1)
    assert companion.value("CURRENT_MODE", "custom_mode") in (AUTO | LOITER, AUTO | MISSION)
    with pytest.raises(ActionError, match="DENIED"):
        companion.action.disarm()  # in the air

    companion.action.return_to_launch()
    companion.wait(lambda: companion.mode() == AUTO | RTL)
    companion.wait(lambda: companion.value("EXTENDED_SYS_STATE", "landed_state") == 4)
    companion.wait(lambda: not companion.armed())
    assert companion.away_m(0, 0) < 2
    assert companion.value("EXTENDED_SYS_STATE", "landed_state") == 1
    assert companion.texts == []  # they are for ground stations
    boot_ms = companion.value("SYSTEM_TIME", "time_boot_ms")
    unix_us = companion.value("SYSTEM_TIME", "time_unix_usec")
    assert unix_us / 1e6 == pytest.approx(1700000000 + boot_ms / 1e3, abs=0.01)
