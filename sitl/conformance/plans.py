"""The steps about missions, fences and rally points."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

from sitl.conformance.expecting import Fields, same, shorten
from sitl.conformance.sending import send
from sitl.conformance.session import DepartureError, Heard, Session
from sitl.px4sim.plan.mission_items import MissionResult

_PATIENCE_S: Final = 3.0
_ANSWERS: Final = ("MISSION_REQUEST_INT", "MISSION_REQUEST", "MISSION_ACK")
KINDS: Final = {"mission": 0, "fence": 1, "rally": 2}  # MAV_MISSION_TYPE
_BOX: Final = ((-1, -1), (-1, 1), (1, 1), (1, -1))


def upload(
    session: Session,
    plan: Sequence[Fields],
    kind: str = "mission",
    result: str = "ACCEPTED",
    refused_at: int | None = None,
) -> None:
    """Send MISSION_COUNT, and the items as they are asked for.

    Args:
        session: With the vehicle.
        plan: See `_items`.
        kind: Mission, fence or rally.
        result: Name of MAV_MISSION_RESULT that MISSION_ACK gives.
        refused_at: The item after which the upload ends; None: after all.
    """
    items = _items(plan)
    expected = len(items) if refused_at is None else refused_at + 1
    send(session, "MISSION_COUNT", {"mission_type": KINDS[kind], "count": len(items)})
    sent = 0
    while True:
        answer = _next_answer(session, _ANSWERS)
        if answer is None:
            raise DepartureError(f"the upload got stuck after {sent} items: no answer")
        fields = answer.fields
        if answer.frame.name == "MISSION_ACK":
            break
        item = _message(session, items[fields["seq"]])
        sent = fields["seq"] + 1
        send(
            session,
            "MISSION_ITEM_INT",
            item | {"seq": fields["seq"], "mission_type": KINDS[kind]},
        )
    got = MissionResult(fields["type"]).name
    session.notes.append(f"upload of {len(items)}: {got} after {sent}")
    if (got, sent) != (result, expected):
        raise DepartureError(
            f"expected MISSION_ACK {result} after {expected} items, heard {got} after {sent}"
        )


def download(
    session: Session,
    items: Sequence[Fields],
    kind: str = "mission",
    *,
    finished: bool = True,
    as_float: bool = False,
) -> None:
    """Send MISSION_REQUEST_LIST and ask for every item.

    Args:
        session: With the vehicle.
        items: Fields that each item is to have, in order.
        kind: Mission, fence or rally.
        finished: Whether the last MISSION_ACK is sent: without it PX4 waits for five seconds.
        as_float: Ask with MISSION_REQUEST.
    """
    of_kind = {"mission_type": KINDS[kind]}
    send(session, "MISSION_REQUEST_LIST", of_kind)
    total = _next_answer(session, ("MISSION_COUNT",))
    if total is None or total.fields["count"] != len(items):
        heard = None if total is None else total.fields["count"]
        raise DepartureError(f"expected MISSION_COUNT {len(items)}, heard {heard}")
    suffix = "" if as_float else "_INT"
    request, reply = f"MISSION_REQUEST{suffix}", f"MISSION_ITEM{suffix}"
    for sequence, wanted in enumerate(items):
        send(session, request, of_kind | {"seq": sequence})
        item = _next_answer(session, (reply, "MISSION_ACK"))
        if item is None or item.frame.name != reply or not same(item.fields, wanted):
            got = None if item is None else shorten(item.fields, wanted)
            raise DepartureError(f"expected item {sequence} {wanted}, heard {got}")
    if finished:
        session.say("MISSION_ACK", mission_type=KINDS[kind], type=0)


def clear(session: Session, kind: str) -> None:
    """Send MISSION_CLEAR_ALL; MISSION_ACK has to come."""
    send(session, "MISSION_CLEAR_ALL", {"mission_type": KINDS[kind]})
    answer = _next_answer(session, ("MISSION_ACK",))
    if answer is None or answer.fields["type"] != MissionResult.ACCEPTED:
        heard = None if answer is None else answer.fields["type"]
        raise DepartureError(f"expected MISSION_ACK ACCEPTED, heard {heard}")


def _items(plan: Sequence[Fields]) -> list[Fields]:
    """The items of a plan, corner by corner where an entry is a polygon.

    An entry has fields of MISSION_ITEM_INT; `at` is its place, metres north and east, and
    `latitude_deg` is sent instead of north. An entry with `box` (north, east, half a side) or
    `polygon` (corners) is an exclusion, or with `inclusion` an inclusion.
    """
    items: list[Fields] = []
    for entry in plan:
        item = dict(entry)
        corners = item.pop("polygon", ())
        if "box" in item:
            north, east, half = item.pop("box")
            corners = [(north + half * x, east + half * y) for x, y in _BOX]
        if corners:
            side = "INCLUSION" if item.pop("inclusion", False) else "EXCLUSION"
            command = f"NAV_FENCE_POLYGON_VERTEX_{side}"
            fence = {"command": command, "frame": 0, "z": 0.0, "params": (len(corners), 0, 0, 0)}
            items += [fence | item | {"at": corner} for corner in corners]
        else:
            items.append(item)
    return items


def _message(session: Session, item: Fields) -> dict[str, Any]:
    """Fields of MISSION_ITEM_INT: by default of a waypoint 15 m above home."""
    fields = dict(item)
    latitude, longitude = session.degrees(*fields.pop("at", (0.0, 0.0)))
    latitude = fields.pop("latitude_deg", latitude)
    params = fields.pop("params", (0.0, 0.0, 0.0, math.nan))
    place: dict[str, Any] = {"x": round(latitude * 1e7), "y": round(longitude * 1e7), "z": 15.0}
    usual = place | {"command": "NAV_WAYPOINT", "frame": 6, "autocontinue": 1}
    usual |= {f"param{number}": value for number, value in enumerate(params, 1)}
    return usual | fields


def _next_answer(session: Session, names: tuple[str, ...]) -> Heard | None:
    answers: list[Heard] = []

    def come() -> bool:
        answers[:] = [heard for name in names for heard in session.since(name)]
        return bool(answers)

    return min(answers, key=lambda heard: heard.at_s) if session.run(_PATIENCE_S, come) else None
