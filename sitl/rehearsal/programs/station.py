"""What is sent to vehicle and companion in a rehearsal: by a ground station, and by strangers."""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from sitl.mavlink.codec import MessagePacker
from sitl.rehearsal.judge.evidence import COMPANION, WireMessage
from sitl.rehearsal.programs.relay import LossyRelay
from sitl.rehearsal.stand_ins.stations import Station

_FLOOD: Final = 300
_LANDS, _ACTIVE, _EMERGENCY = 0x06040000, 4, 6  # of HEARTBEAT: AUTO, LAND; MAV_STATE


def intrusion(kind: str, dice: random.Random) -> list[bytes]:
    """The datagrams of one kind; see `scenes`."""
    pack = MessagePacker(1, 1).pack
    heartbeat = {"type": 2, "autopilot": 12, "custom_mode": _LANDS, "mavlink_version": 3}
    if kind == "noise":
        return [dice.randbytes(dice.randrange(1, 300)) for _ in range(20)]
    if kind == "truncated":
        whole = pack("HEARTBEAT", {**heartbeat, "system_status": _ACTIVE})
        return [whole[:length] for length in range(1, len(whole))]
    if kind == "flood":
        return [pack("PING", {"seq": number}) for number in range(_FLOOD)]
    if kind == "other vehicle":
        emergency = {**heartbeat, "system_status": _EMERGENCY}
        return [MessagePacker(2, 1).pack("HEARTBEAT", emergency)]
    boot = {"time_boot_ms": 1000}  # as a vehicle that has just been started
    place = {"lat": 399421523, "lon": -751997644}
    return [
        pack("SYSTEM_TIME", boot),
        pack("GLOBAL_POSITION_INT", {**boot, **place}),
        pack("ATTITUDE", boot),
    ]


_SYSTEM: Final = 255
_ITEM: Final = (
    *("frame", "command", "current", "autocontinue", "param1", "param2", "param3", "param4"),
    *("x", "y", "z"),
)


def station_at(relay: LossyRelay, system: int = _SYSTEM) -> Station:
    """A station that the vehicle hears through the relay."""
    return Station(system, lambda sender, *message: relay.inject(sender.pack(*message)))


def upload(
    relay: LossyRelay, items: Sequence[Mapping[str, Any]], stored: Callable[[], object]
) -> None:
    """Begin to put a mission on board: the vehicle asks for its items until it has `stored` it."""
    station = station_at(relay)

    def answer(message: WireMessage) -> None:
        if message.target != _SYSTEM:
            return
        if message.name == "MISSION_ACK":
            stored()
        elif message.name in {"MISSION_REQUEST_INT", "MISSION_REQUEST"}:
            seq = int(message.fields["seq"])
            if seq < len(items):
                fields = {name: items[seq][name] for name in _ITEM}
                station.say("MISSION_ITEM_INT", seq=seq, **fields)

    relay.answers = answer
    station.say("MISSION_COUNT", count=len(items))


def plan_of(messages: Sequence[WireMessage], *, backwards: bool) -> list[dict[str, Any]]:
    """The mission that the companion has put on board, as a station would send it again.

    All of its places are moved a little; it may go through those behind the first backwards.
    """
    items = {
        int(m.fields["seq"]): dict(m.fields)
        for m in messages
        if m.name == "MISSION_ITEM_INT"
        and m.component == COMPANION
        and m.fields.get("mission_type", 0) == 0
    }
    plan = [{**items[n], "x": items[n]["x"] + 1, "y": items[n]["y"] - 1} for n in sorted(items)]
    return [*plan[:3], *reversed(plan[3:])] if backwards else plan
