"""The stand-in for MAVSDK hands over a transfer's result and its MISSION_ACK in either order."""

import asyncio
import json

import pytest

from sitl.rehearsal.companion import SimulatedLoop, World
from sitl.rehearsal.fakes.mavsdk import StandIn
from sitl.rehearsal.faults import Fault, Scene, scenes
from sitl.rehearsal.takeovers import LISTS_AMONG_OURS

OURS = {"target_system": 1, "target_component": 191, "mission_type": 1}
HEARTBEAT = {"type": 2, "autopilot": 12, "base_mode": 0, "custom_mode": 0, "system_status": 3}


def read_of_an_upload(*, result_first):
    """What a companion reads of an empty upload and of two messages behind its answer."""
    read = []

    async def script():
        def send(name, _fields):
            if name == "MISSION_COUNT":
                link.receive("MISSION_ACK", {**OURS, "type": 0, "opaque_id": 7})
                for seq in (1, 2):
                    link.receive("MISSION_CURRENT", {"seq": seq})

        link = StandIn(send, "udpin://0.0.0.0:14540", 1, result_first=result_first)
        link.listen("MISSION_COUNT", lambda _: None)
        asyncio.get_running_loop().call_soon(link.receive, "HEARTBEAT", HEARTBEAT)
        plugins = await link.open()
        for name in ("MISSION_ACK", "MISSION_CURRENT"):
            plugins.direct.subscribe_message(
                name, lambda m, _: read.append((m.message_name, json.loads(m.fields_json)))
            )
        stored = asyncio.Event()
        plugins.raw.upload_geofence_async(
            [], lambda result, _: (read.append((result.name, {})), stored.set())
        )
        await stored.wait()
        await asyncio.sleep(0.1)
        await link.close()

    loop = SimulatedLoop(World())
    try:
        loop.run_until_complete(script())
    finally:
        loop.close()
    return [(name, fields.get("seq")) for name, fields in read]


@pytest.mark.parametrize("result_first", [True, False])
def test_the_result_and_its_answer_come_in_either_order_and_messages_in_theirs(result_first):
    messages = [("MISSION_ACK", None), ("MISSION_CURRENT", 1), ("MISSION_CURRENT", 2)]
    read = read_of_an_upload(result_first=result_first)
    assert [each for each in read if each[0] != "SUCCESS"] == messages
    assert read.index(("SUCCESS", None)) == (0 if result_first else 3)


def test_a_rehearsal_has_both_orders_in_many_kinds_and_in_each_of_the_turns_of_lists():
    orders = {}
    for scene in scenes():
        orders.setdefault(scene.fault, set()).add(scene.result_first)
    assert sum(each == {True, False} for each in orders.values()) > 0.9 * len(orders)
    turns = len(LISTS_AMONG_OURS)
    for turn in range(turns):
        both = {Scene(Fault.LIST_AMONG_OURS, turn + again * turns).result_first for again in (0, 1)}
        assert both == {True, False}
