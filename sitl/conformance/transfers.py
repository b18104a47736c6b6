"""The steps about parameters, missions, fences and rally points."""

import math
import struct
from collections.abc import Sequence
from typing import Any, Final

from sitl.conformance.expecting import Fields, same, shorten
from sitl.conformance.sending import send
from sitl.conformance.session import DepartureError, Heard, Session
from sitl.px4sim.plan_store import UploadResult

_INT32, _REAL32 = 6, 9  # MAV_PARAM_TYPE
_QUIET_S: Final = 1.0


def set_parameter(session: Session, name: str, value: float, answers: int = 2) -> None:
    """Send PARAM_SET, and count the PARAM_VALUEs that answer it.

    Args:
        session: With the vehicle.
        name: Of the parameter.
        value: An int is sent as INT32, bytewise, as PX4 has it; a float as REAL32.
        answers: How many PARAM_VALUEs come: two (on a busy machine sometimes three) for a change,
            one for none, none if refused.
    """
    values = _changed(session, name, value, answers)
    enough = len(values) >= 2 if answers == 2 else len(values) == answers
    if not enough:
        raise DepartureError(f"expected {answers} PARAM_VALUEs, heard {values}")


def ensure_parameter(session: Session, name: str, value: float) -> None:
    """Send PARAM_SET; whether that is a change does not matter."""
    if not _changed(session, name, value, 2):
        raise DepartureError(f"expected a PARAM_VALUE of {name}, heard none")


def _changed(session: Session, name: str, value: float, answers: int) -> list[float]:
    """Send PARAM_SET; the values that were answered, which have to be the one that was sent."""
    whole = isinstance(value, int)
    sent = struct.unpack("<f", struct.pack("<i", value))[0] if whole else value
    kind = _INT32 if whole else _REAL32
    send(session, "PARAM_SET", {"param_id": name, "param_value": sent, "param_type": kind})
    values = _values(session, name, answers)
    session.notes.append(f"{name}: {len(values)} answers {values}")
    wanted = struct.unpack("<f", struct.pack("<f", value))[0]
    if any(abs(got - wanted) > 1e-6 for got in values):
        raise DepartureError(f"expected {value}, heard {values}")
    return values


def parameter(session: Session, name: str, value: float | None) -> None:
    """Ask for a parameter by name; None: silence is expected."""
    wanted = [] if value is None else [value]
    send(session, "PARAM_REQUEST_READ", {"param_id": name, "param_index": -1})
    values = _values(session, name, len(wanted))
    if len(values) != len(wanted) or not all(map(math.isclose, values, wanted)):
        raise DepartureError(f"expected {value}, heard {values or 'silence'}")


def all_parameters(session: Session, among: Sequence[str], fewest: int, within_s: float) -> None:
    """Send PARAM_REQUEST_LIST: every parameter comes in time, these among them."""
    send(session, "PARAM_REQUEST_LIST")
    names: set[str] = set()
    counts: set[int] = set()

    def complete() -> bool:
        for heard in session.since("PARAM_VALUE"):
            if heard.fields["param_index"] < 65535:
                names.add(heard.fields["param_id"])
                counts.add(heard.fields["param_count"])
        return bool(counts) and len(names) >= max(counts)

    begun_s = session.now_s
    done = session.run(within_s, complete)
    session.notes.append(f"{len(names)} parameters in {session.now_s - begun_s:.2f} s")
    missing = [name for name in among if name not in names]
    if not done or len(names) < fewest or missing:
        raise DepartureError(
            f"expected {fewest} parameters within {within_s:g} s, "
            f"heard {len(names)} of {counts}, without {missing}"
        )


def _values(session: Session, name: str, wanted: int) -> list[float]:
    def values() -> list[float]:
        return [
            _value(heard.fields)
            for heard in session.since("PARAM_VALUE")
            if heard.fields["param_id"] == name
        ]

    session.run(_QUIET_S, lambda: wanted > 0 and len(values()) >= wanted)
    session.run(0.2)
    return values()


def _value(fields: dict[str, Any]) -> float:
    value: float = fields["param_value"]
    if fields["param_type"] == _INT32:
        whole: int = struct.unpack("<i", struct.pack("<f", value))[0]
        return whole
    return value


_PATIENCE_S: Final = 3.0
_ANSWERS: Final = ("MISSION_REQUEST_INT", "MISSION_ACK")
_KINDS: Final = {"mission": 0, "fence": 1, "rally": 2}  # MAV_MISSION_TYPE
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
    send(session, "MISSION_COUNT", {"mission_type": _KINDS[kind], "count": len(items)})
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
            item | {"seq": fields["seq"], "mission_type": _KINDS[kind]},
        )
    got = UploadResult(fields["type"]).name
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
) -> None:
    """Send MISSION_REQUEST_LIST and ask for every item.

    Args:
        session: With the vehicle.
        items: Fields that each item is to have, in order.
        kind: Mission, fence or rally.
        finished: Whether the last MISSION_ACK is sent: without it PX4 waits for five seconds.
    """
    of_kind = {"mission_type": _KINDS[kind]}
    send(session, "MISSION_REQUEST_LIST", of_kind)
    total = _next_answer(session, ("MISSION_COUNT",))
    if total is None or total.fields["count"] != len(items):
        heard = None if total is None else total.fields["count"]
        raise DepartureError(f"expected MISSION_COUNT {len(items)}, heard {heard}")
    reply = "MISSION_ITEM_INT"
    for sequence, wanted in enumerate(items):
        send(session, "MISSION_REQUEST_INT", of_kind | {"seq": sequence})
        item = _next_answer(session, (reply, "MISSION_ACK"))
        if item is None or item.frame.name != reply or not same(item.fields, wanted):
            got = None if item is None else shorten(item.fields, wanted)
            raise DepartureError(f"expected item {sequence} {wanted}, heard {got}")
    if finished:
        session.say("MISSION_ACK", mission_type=_KINDS[kind], type=0)


def clear(session: Session, kind: str) -> None:
    """Send MISSION_CLEAR_ALL; MISSION_ACK has to come."""
    send(session, "MISSION_CLEAR_ALL", {"mission_type": _KINDS[kind]})
    answer = _next_answer(session, ("MISSION_ACK",))
    if answer is None or answer.fields["type"] != UploadResult.ACCEPTED:
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
