"""What is not the autopilot sends on its link: nothing of that counts as the autopilot's.

Real MAVSDK over UDP; all come from the vehicle's own address, as through a router or a radio.
"""

import asyncio

import pytest

from air_router.vehicle.vehicle import FlightMode, Telemetry
from sitl.rehearsal.fakes.stations import FOREIGN, foreign_vocabulary
from tests.system.orders.verbs import ORDERS, follows, hold

pytestmark = pytest.mark.xdist_group("orders")

TURNS = 30  # of the vehicle's, in which all of them send


@pytest.mark.parametrize("sender", FOREIGN, ids=str)
def test_what_another_component_or_system_sends_changes_nothing(run, mission, sender):
    events = []

    async def script(vehicle):
        before = vehicle.telemetry.snapshot()
        vehicle.subscribe(events.append)
        px4s[0].others = [(*sender, *message) for message in foreign_vocabulary(2000)]
        await asyncio.to_thread(px4s[0].wait_for_heartbeats, TURNS)
        px4s[0].others = []
        after = vehicle.telemetry.snapshot()
        for name in ("mode", "armed", "in_air", "battery", "item", "fix", "failsafe", "position"):
            assert getattr(after, name) == getattr(before, name), name

    px4s = []
    run(lambda *_: None, script, keep=px4s)
    telemetry = [event for event in events if isinstance(event, Telemetry)]
    assert telemetry
    assert {event.mode for event in telemetry} == {FlightMode.MISSION}
    assert [event for event in events if not isinstance(event, Telemetry)] == []


@pytest.mark.parametrize("sender", FOREIGN, ids=str)
def test_what_another_sends_answers_no_request_for_the_mode(run, sender):
    """Else a gimbal's HEARTBEAT would let an order leave, or keep it back."""
    px4s = []

    async def script(vehicle):
        px4s[0].others = [(*sender, *message) for message in foreign_vocabulary(2000)]
        await hold(vehicle)

    px4 = run(follows, script, keep=px4s)
    assert px4.commands() == ORDERS[hold]
