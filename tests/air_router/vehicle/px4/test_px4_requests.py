"""Queries to a PX4 on the ground, and what is made of its answers."""

import asyncio
import json
import struct
from types import SimpleNamespace

import pytest
from mavsdk.plugins.mavlink_direct.mavlink_direct import MavlinkDirectResult

from air_router.vehicle.clock import VehicleClock
from air_router.vehicle.px4 import px4_requests
from air_router.vehicle.px4.mavlink_values import PREARM_GOOD
from air_router.vehicle.px4.mavsdk_bridge import Received
from air_router.vehicle.px4.px4_events import ARMING_SUMMARY, HEALTH_SUMMARY, event_id
from air_router.vehicle.px4.px4_telemetry import Px4Telemetry
from air_router.vehicle.vehicle import GpsFix

INT32, REAL32 = 6, 9


class Autopilot:
    """What answers to an inspection: parameters (each after some losses), and a report."""

    def __init__(self, telemetry, values, *, losses=0, findings=(), reports_absent=False):
        self.telemetry = telemetry
        self.values = values
        self.losses = losses
        self.findings = findings
        self.reports_absent = reports_absent  # as PX4 1.18 does
        self.requested = []

    def send_message(self, sent):
        fields = json.loads(sent.fields_json)
        assert sent.message_name == "PARAM_REQUEST_READ"
        name = fields["param_id"]
        self.requested.append(name)
        if self.losses > 0:
            self.losses -= 1
        elif name in self.values:
            value = self.values[name]
            whole = isinstance(value, int)
            self._deliver(
                "parameter",
                param_id=name,
                param_type=INT32 if whole else REAL32,
                param_value=struct.unpack("<f", struct.pack("<i", value))[0] if whole else value,
            )
        elif self.reports_absent:
            self._deliver("parameter_error", param_id=name, param_index=-1, error=1)

    def send_command_async(self, sent, callback):
        fields = json.loads(sent.fields_json)
        assert fields["command"] == 401
        answer = SimpleNamespace(fields_json=json.dumps({"result": 0}))
        callback(MavlinkDirectResult.SUCCESS, answer, None)
        self._event(ARMING_SUMMARY, struct.pack("<BIIII", 0, 0, 0, 0, 0), 7)
        for name in self.findings:
            self._event(name, struct.pack("<IB", 0xFFFFFFFF, 0), 3)
        self._event(HEALTH_SUMMARY, struct.pack("<BIII", 0, 0, 0, 0), 7)

    def _event(self, name, arguments, level):
        padded = list(arguments.ljust(40, b"\0"))
        self._deliver("event", id=event_id(name), log_levels=level, arguments=padded)

    def _deliver(self, what, **fields):
        handler = getattr(self.telemetry, f"_on_{what}")
        self.telemetry._only_autopilot(what, handler)(Received(fields, (1, 1), 0.0))


@pytest.fixture(autouse=True)
def short(monkeypatch):
    for name in ("INSPECTION_HEALTH_S", "ARMING_REPORT_S", "PARAMETER_RESPONSE_S"):
        monkeypatch.setattr(px4_requests, name, 0.01)


def inspect(pennovation, names, *, health=PREARM_GOOD, **autopilot):
    async def main():
        telemetry = Px4Telemetry(pennovation.frame, VehicleClock())
        status = {"battery_remaining": 80, "onboard_control_sensors_health": health}
        telemetry._on_sys_status(status | {"voltage_battery": 15800})
        telemetry.gps.take(
            {"fix_type": 3, "satellites_visible": 12, "h_acc": 900, "alt": 0, "time_usec": 0}
        )
        telemetry.system_id = 1
        telemetry._direct = direct = Autopilot(telemetry, **autopilot)
        found = await px4_requests.inspect(telemetry, names)
        return found, direct.requested

    return asyncio.run(main())


def test_parameters_of_both_kinds_and_one_that_does_not_exist(pennovation):
    values = {"GF_ACTION": 2, "NAV_ACC_RAD": 2.5}
    found, requested = inspect(pennovation, (*values, "NOPE"), values=values)
    assert found.parameters == {"GF_ACTION": 2.0, "NAV_ACC_RAD": 2.5, "NOPE": None}
    assert requested.count("GF_ACTION") == 1
    assert 2 <= requested.count("NOPE") <= 5


def test_a_parameter_that_px4_reports_as_absent_is_requested_once(pennovation):
    found, requested = inspect(
        pennovation, ("GF_ACTION", "NOPE"), values={"GF_ACTION": 2}, reports_absent=True
    )
    assert (found.parameters["NOPE"], found.absent) == (None, {"NOPE"})
    assert requested.count("NOPE") == 1


def test_what_is_lost_on_the_way_is_requested_again(pennovation):
    values = {f"P{n}": n for n in range(8)}
    found, _ = inspect(pennovation, tuple(values), values=values, losses=20)
    assert found.parameters == values


def test_a_healthy_vehicle(pennovation):
    found, _ = inspect(pennovation, (), values={})
    assert (found.healthy, found.problems, found.warnings) == (True, (), ())
    assert (found.gps, found.battery, found.voltage_v) == (GpsFix(3, 12, 0.9), 0.8, 15.8)


def test_an_unhealthy_one_reports_why_in_words(pennovation):
    findings = ("check_estimator_gps_fix_too_low", "check_mag_missing")
    found, _ = inspect(pennovation, (), values={}, health=0, findings=findings)
    assert not found.healthy
    assert [p.partition(";")[0] for p in found.problems] == ["no GPS fix", "compass 0 is missing"]
