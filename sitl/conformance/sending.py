"""The steps that send to the vehicle, and its replies: commands, parameters, plans."""

import math
import struct
from collections.abc import Sequence
from typing import Final

from sitl.conformance.expecting import Fields, same, shorten
from sitl.conformance.session import (
    COMPANION,
    GROUND_STATION,
    DepartureError,
    LinkKind,
    ReceivedMessage,
    Session,
)
from sitl.mavlink import command_number
from sitl.px4sim import CommandResult, FlightMode, UploadResult

_EXTRA_S: Final = 0.3
_MOVES_S: Final = 0.05
_TWICE: Final = ((1, 16), (1, 17))  # answer DO_SET_MODE
_WITHOUT_INT: Final = (
    1,
    16,
)  # and before: requests by MISSION_REQUEST until MISSION_ITEM_INT comes
_NO_POSITION: Final = 2**31 - 1
_RESULTS: Final = {result.value: result.name for result in CommandResult}
_SENDERS: Final = {"ground station": GROUND_STATION, "companion": COMPANION, "silent": None}


def send(session: Session, name: str, fields: Fields | None = None) -> None:
    """Send a message; a target that is not given is the vehicle's autopilot."""
    session.mark()
    session.send(name, **(fields or {}))


def command(  # noqa: PLR0913 - a case's terms of a command
    session: Session,
    name: str | int,
    params: Sequence[float] = (),
    answers: Sequence[str] = ("ACCEPTED",),
    *,
    within_s: float = 1.0,
    target: Sequence[int | None] | None = None,
) -> None:
    """Send a COMMAND_LONG; COMMAND_ACKs with these results have to come, none: silence.

    Params that are missing are NaN. The target is a system (None: the vehicle) and component id.
    """
    padded = (*params, *(math.nan,) * (7 - len(params)))
    fields: Fields = {f"param{number}": value for number, value in enumerate(padded, 1)}
    if target is not None:
        system, component = target
        fields["target_system"] = session.vehicle_id if system is None else system
        fields["target_component"] = component
    send(session, "COMMAND_LONG", fields | {"command": name})
    _expect_acks(session, name, answers, within_s)


def set_mode(
    session: Session,
    mode: str | tuple[int, int],
    result: str = "ACCEPTED",
    base_mode: int = 1,
) -> None:
    """Send DO_SET_MODE with a `FlightMode`, or main mode and submode.

    PX4 1.16 and 1.17 acknowledge ACCEPTED first, and the result when they have decided; others
    acknowledge once.
    """
    main, sub = FlightMode[mode].value[:2] if isinstance(mode, str) else mode
    first = ("ACCEPTED",) if session.version in _TWICE else ()
    command(session, "DO_SET_MODE", (base_mode, main, sub), (*first, result))


def take_off(session: Session, up_m: float) -> None:
    """Send NAV_TAKEOFF to a height above home."""
    command(session, "NAV_TAKEOFF", (*(math.nan,) * 6, session.ground_amsl_m + up_m))


def go_to(
    session: Session,
    place: Sequence[float | None],
    answer: str = "ACCEPTED",
    fields: Fields | None = None,
) -> None:
    """Send DO_REPOSITION as COMMAND_INT.

    Args:
        session: With the vehicle.
        place: Metres north and east (None: "no position") and above home, sent as AMSL.
        answer: Name of MAV_RESULT.
        fields: Of the message, instead of what the place makes of them.
    """
    north_m, east_m, up_m = place
    x = y = _NO_POSITION
    if north_m is not None and east_m is not None:
        latitude, longitude = session.degrees(north_m, east_m)
        x, y = round(latitude * 1e7), round(longitude * 1e7)
    z = math.nan if up_m is None else up_m + session.ground_amsl_m
    usual: Fields = {"command": "DO_REPOSITION", "frame": 5, "param1": -1.0, "param2": 1.0}
    usual |= {"param4": math.nan, "x": x, "y": y, "z": z}
    send(session, "COMMAND_INT", usual | (fields or {}))
    _expect_acks(session, "DO_REPOSITION", (answer,), 1.0)


def sticks(session: Session, moved: dict[str, int], over_s: float = 0.0) -> None:
    """Stream MANUAL_CONTROL: x (pitch), y, r -1000 to 1000, z (throttle) 0 to 1000.

    Args:
        session: With the vehicle.
        moved: Where to; the others are in their middle.
        over_s: How long the way there takes, at the same speed.
    """
    wanted, before = {"z": 500} | moved, session.sticks or {}
    steps = round(over_s / _MOVES_S)
    for step in range(1, steps):
        start = {axis: before.get(axis, 500 if axis == "z" else 0) for axis in wanted}
        share = step / steps
        session.sticks = {a: round(start[a] + share * (wanted[a] - start[a])) for a in wanted}
        session.run(_MOVES_S)
    session.sticks = wanted


def stop(session: Session, _: None) -> None:
    """Stop the sticks."""
    session.sticks = None


def heartbeats(session: Session, sender: str, link: str = "API") -> None:
    """Change whose heartbeats are sent on a link; a companion has the vehicle's system id."""
    identity = _SENDERS[sender]
    if identity is None:
        session.beats.pop(LinkKind(link), None)
    else:
        kind, system, component = identity
        own = session.vehicle_id if sender == "companion" else system
        session.beats[LinkKind(link)] = (kind, own, component)


def wait(session: Session, seconds: float) -> None:
    """Let the vehicle's time pass."""
    session.run(seconds)


def mark(session: Session, _: None) -> None:
    """Only messages from now on count for the next expectation."""
    session.mark()


def _expect_acks(
    session: Session, name: str | int, answers: Sequence[str], within_s: float
) -> None:
    number = command_number(name)

    def results() -> list[str]:
        received = (one.fields for one in session.since("COMMAND_ACK"))
        acks = (fields["result"] for fields in received if fields["command"] == number)
        return [_RESULTS.get(result, str(result)) for result in acks]

    if answers:
        session.run_to_reply(within_s, lambda: len(results()) >= len(answers))
    else:
        session.run(within_s)
    session.run(_EXTRA_S)
    session.notes.append(f"{number}: {', '.join(results()) or 'silence'}")
    # Of DO_SET_MODE's two COMMAND_ACKs either may be first when the machine is busy.
    if sorted(results()) != sorted(answers):
        raise DepartureError(f"expected the results {list(answers)}, received {results()}")


# Parameters, missions, fences and rally points.

_INT32, _REAL32 = 6, 9  # MAV_PARAM_TYPE
_QUIET_S: Final = 1.0


def set_parameter(session: Session, name: str, value: float, answers: int | None = 2) -> None:
    """Send PARAM_SET, and count the PARAM_VALUEs that reply with the value that was sent.

    Args:
        session: With the vehicle.
        name: Of the parameter.
        value: An int is sent as INT32, bytewise, as PX4 has it; a float as REAL32.
        answers: How many PARAM_VALUEs come: two (on a busy machine sometimes three) for a change,
            one for none, none if refused. None: any, whether that is a change or not.
    """
    whole = isinstance(value, int)
    sent = struct.unpack("<f", struct.pack("<i", value))[0] if whole else value
    kind = _INT32 if whole else _REAL32
    send(session, "PARAM_SET", {"param_id": name, "param_value": sent, "param_type": kind})
    values = _values(session, name, 2 if answers is None else answers)
    session.notes.append(f"{name}: {len(values)} replies {values}")
    wanted = struct.unpack("<f", struct.pack("<f", value))[0]
    if any(abs(got - wanted) > 1e-6 for got in values):
        raise DepartureError(f"expected {value}, received {values}")
    least = 1 if answers is None else answers
    if len(values) < least or (answers in {0, 1} and len(values) > least):
        raise DepartureError(f"expected {least} PARAM_VALUEs of {name}, received {values}")


def parameter(session: Session, name: str, value: float | None) -> None:
    """Request a parameter by name; None: silence is expected."""
    wanted = [] if value is None else [value]
    send(session, "PARAM_REQUEST_READ", {"param_id": name, "param_index": -1})
    values = _values(session, name, len(wanted))
    if len(values) != len(wanted) or not all(map(math.isclose, values, wanted)):
        raise DepartureError(f"expected {value}, received {values or 'silence'}")


def all_parameters(session: Session, among: Sequence[str], fewest: int, within_s: float) -> None:
    """Send PARAM_REQUEST_LIST: every parameter comes in time, these among them."""
    send(session, "PARAM_REQUEST_LIST")
    names: set[str] = set()
    counts: set[int] = set()

    def complete() -> bool:
        for received in session.since("PARAM_VALUE"):
            if received.fields["param_index"] < 65535:
                names.add(received.fields["param_id"])
                counts.add(received.fields["param_count"])
        return bool(counts) and len(names) >= max(counts)

    begun_s = session.now_s
    done = session.run(within_s, complete)
    session.notes.append(f"{len(names)} parameters in {session.now_s - begun_s:.2f} s")
    missing = [name for name in among if name not in names]
    if not done or len(names) < fewest or missing:
        raise DepartureError(
            f"expected {fewest} parameters within {within_s:g} s, "
            f"received {len(names)} of {counts}, without {missing}"
        )


def _values(session: Session, name: str, wanted: int) -> list[float]:
    def values() -> list[float]:
        received = (one.fields for one in session.since("PARAM_VALUE"))
        return [_value(fields) for fields in received if fields["param_id"] == name]

    if wanted:
        session.run_to_reply(_QUIET_S, lambda: len(values()) >= wanted)
    else:
        session.run(_QUIET_S)
    session.run(0.2)
    return values()


def _value(fields: Fields) -> float:
    value: float = fields["param_value"]
    if fields["param_type"] == _INT32:
        (value,) = struct.unpack("<i", struct.pack("<f", value))
    return value


_PATIENCE_S: Final = 3.0
_KINDS: Final = {"mission": 0, "fence": 1, "rally": 2}  # MAV_MISSION_TYPE
_BOX: Final = ((-1, -1), (-1, 1), (1, 1), (1, -1))


def upload(
    session: Session,
    plan: Sequence[Fields],
    kind: str = "mission",
    result: str = "ACCEPTED",
    refused_at: int | None = None,
) -> None:
    """Send MISSION_COUNT, and the items as they are requested: by MISSION_REQUEST_INT.

    Before 1.17 PX4 requests by MISSION_REQUEST as well.

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
    requests = ["MISSION_REQUEST_INT", *(["MISSION_REQUEST"] if _before_int(session) else [])]
    while True:
        reply = _next_reply(session, *requests, "MISSION_ACK")
        if reply is None:
            raise DepartureError(f"the upload got stuck after {sent} items: no reply")
        fields = reply.fields
        if reply.name == "MISSION_ACK":
            break
        of_kind = {"seq": fields["seq"], "mission_type": _KINDS[kind]}
        send(session, "MISSION_ITEM_INT", _message(session, items[fields["seq"]]) | of_kind)
        sent = fields["seq"] + 1
    got = UploadResult(fields["type"]).name
    session.notes.append(f"upload of {len(items)}: {got} after {sent}")
    if (got, sent) != (result, expected):
        raise DepartureError(
            f"expected MISSION_ACK {result} after {expected} items, received {got} after {sent}"
        )


def _before_int(session: Session) -> bool:
    """Whether this PX4 requests items by MISSION_REQUEST until a MISSION_ITEM_INT came."""
    return session.version <= _WITHOUT_INT


def download(
    session: Session,
    items: Sequence[Fields],
    kind: str = "mission",
    *,
    finished: bool = True,
) -> None:
    """Send MISSION_REQUEST_LIST and request every item.

    Args:
        session: With the vehicle.
        items: Fields that each item is to have, in order.
        kind: Mission, fence or rally.
        finished: Whether the last MISSION_ACK is sent: without it PX4 waits for five seconds.
    """
    of_kind = {"mission_type": _KINDS[kind]}
    send(session, "MISSION_REQUEST_LIST", of_kind)
    total = _next_reply(session, "MISSION_COUNT")
    count = None if total is None else total.fields["count"]
    if count != len(items):
        raise DepartureError(f"expected MISSION_COUNT {len(items)}, received {count}")
    reply = "MISSION_ITEM_INT"
    for sequence, wanted in enumerate(items):
        send(session, "MISSION_REQUEST_INT", of_kind | {"seq": sequence})
        item = _next_reply(session, reply, "MISSION_ACK")
        if item is None or item.name != reply or not same(item.fields, wanted):
            got = None if item is None else shorten(item.fields, wanted)
            raise DepartureError(f"expected item {sequence} {wanted}, received {got}")
    if finished:
        session.send("MISSION_ACK", mission_type=_KINDS[kind], type=0)


def clear(session: Session, kind: str) -> None:
    """Send MISSION_CLEAR_ALL; MISSION_ACK has to come."""
    send(session, "MISSION_CLEAR_ALL", {"mission_type": _KINDS[kind]})
    reply = _next_reply(session, "MISSION_ACK")
    result = None if reply is None else reply.fields["type"]
    if result != UploadResult.ACCEPTED:
        raise DepartureError(f"expected MISSION_ACK ACCEPTED, received {result}")


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


def _message(session: Session, item: Fields) -> Fields:
    """Fields of MISSION_ITEM_INT: by default of a waypoint 15 m above home."""
    fields = dict(item)
    latitude, longitude = session.degrees(*fields.pop("at", (0.0, 0.0)))
    latitude = fields.pop("latitude_deg", latitude)
    params = fields.pop("params", (0.0, 0.0, 0.0, math.nan))
    place: Fields = {"x": round(latitude * 1e7), "y": round(longitude * 1e7), "z": 15.0}
    usual = place | {"command": "NAV_WAYPOINT", "frame": 6, "autocontinue": 1}
    usual |= {f"param{number}": value for number, value in enumerate(params, 1)}
    return usual | fields


def _next_reply(session: Session, *names: str) -> ReceivedMessage | None:
    session.run_to_reply(_PATIENCE_S, lambda: bool(session.since(*names)))
    return next(iter(session.since(*names)), None)
