"""What strangers send to a companion's port: noise, and messages that no vehicle of ours sent."""

from __future__ import annotations

import random
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

_FLOOD = 300


def intrusion(kind: str, dice: random.Random) -> list[bytes]:
    """The datagrams of one kind; see `scenes`."""
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    if kind == "noise":
        return [dice.randbytes(dice.randrange(1, 300)) for _ in range(20)]
    if kind == "truncated":
        whole = _packed(sender, sender.heartbeat_encode(2, 12, 0, 0x06040000, 4))
        return [whole[:length] for length in range(1, len(whole))]
    if kind == "flood":
        return [_packed(sender, sender.ping_encode(0, n, 0, 0)) for n in range(_FLOOD)]
    if kind == "other vehicle":
        other = mavlink.MAVLink(None, srcSystem=2, srcComponent=1)
        return [_packed(other, other.heartbeat_encode(2, 12, 0, 0x06040000, 6))]
    home = (399421523, -751997644)
    return [  # as a vehicle that has just been started
        _packed(sender, sender.system_time_encode(0, 1000)),
        _packed(sender, sender.global_position_int_encode(1000, *home, 0, 0, 0, 0, 0, 0)),
        _packed(sender, sender.attitude_encode(1000, 0, 0, 0, 0, 0, 0)),
    ]


def _packed(sender: Any, message: Any) -> bytes:
    return bytes(message.pack(sender))
