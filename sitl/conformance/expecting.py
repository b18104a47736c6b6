"""The steps that expect a message, or silence; those about how the vehicle flies."""

import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Final

from sitl.conformance.session import (
    DepartureError,
    LinkKind,
    PositionEstimate,
    ReceivedMessage,
    Session,
)
from sitl.mavlink import command_number
from sitl.px4sim import FlightMode, Notice, Severity

Fields = dict[str, Any]
_ARMED: Final = 128
_STATES: Final = ("mission_state", "mission_mode")
_REPORTS_STATE: Final = (1, 17)


def mode_name(custom_mode: int) -> str:
    """The name of PX4's mode in a HEARTBEAT.custom_mode."""
    unknown = f"{custom_mode >> 16 & 0xFF}/{custom_mode >> 24 & 0xFF}"
    return next((mode.name for mode in FlightMode if mode.custom_mode == custom_mode), unknown)


def event_id(name: str) -> int:
    """The number by which EVENT names one of PX4's events, such as `commander_armed_by`."""
    return Notice(Severity.INFO, event=name).event_id


# Read out of a message's fields as a case has them: what does not stand there by that name.
_READINGS: Final[dict[str, Callable[[Fields], Any]]] = {
    "mode": lambda fields: mode_name(fields["custom_mode"]),
    "intended": lambda fields: mode_name(fields["intended_custom_mode"]),
    "armed": lambda fields: bool(fields["base_mode"] & _ARMED),
}


def expect(  # noqa: PLR0913 - a case's terms of a message
    session: Session,
    name: str,
    fields: Fields | None = None,
    within_s: float = 2.0,
    *,
    link: str = "API",
    times: int = 1,
    since_s: float = -math.inf,
) -> None:
    """A message comes within some seconds, or has come since the exchange began.

    Args:
        session: With the vehicle.
        name: Of the message.
        fields: Values that it is to have; floats within 1e-3 or so.
        within_s: How long to wait.
        link: On which link.
        times: How often, in that time.
        since_s: Only what comes from then on counts.
    """
    wanted = _expected_fields(session, name, fields or {})

    def come() -> bool:
        received = _matching(session, name, wanted, link)
        return sum(one.at_s >= since_s for one in received) >= times

    if not session.run(within_s, come):
        received = [shorten(one.fields, wanted) for one in session.since(name, link=LinkKind(link))]
        raise DepartureError(
            f"expected {name} {wanted or ''} within {within_s:g} s, received {received or 'none'}"
        )


def _expected_fields(session: Session, name: str, fields: Fields) -> Fields:
    """The fields that a version sends: before 1.17 no mission_state and no mission_mode."""
    if name != "MISSION_CURRENT" or session.version >= _REPORTS_STATE:
        return fields
    return fields | {field: 0 for field in _STATES if field in fields}


def nothing(
    session: Session, name: str, for_s: float, fields: Fields | None = None, link: str = "API"
) -> None:
    """A message does not come for some seconds, nor has since the exchange began."""
    session.run(for_s)
    came = [shorten(one.fields, fields or {}) for one in _matching(session, name, fields, link)]
    if came:
        raise DepartureError(f"expected no {name} for {for_s:g} s, received {came}")


def count(
    session: Session, name: str, fields: Fields, for_s: float, between: tuple[int, int]
) -> None:
    """So many messages come in some seconds."""
    session.run(for_s)
    number = len(_matching(session, name, fields))
    which = " ".join(str(value) for value in fields.values())
    session.notes.append(f"{number} x {name} {which} in {for_s:g} s")
    if not between[0] <= number <= between[1]:
        raise DepartureError(f"expected {between[0]} to {between[1]}, received {session.notes[-1]}")


def rates(
    session: Session,
    wanted: dict[str, tuple[float, float]],
    for_s: float = 10.0,
    link: str = "API",
) -> None:
    """Messages come by themselves, so many per second of the vehicle's time, least and most."""
    before, begun_s = session.counts.copy(), session.now_s
    session.run(for_s)
    seconds = session.now_s - begun_s
    counted = {
        name: (session.counts[LinkKind(link), name] - before[LinkKind(link), name]) / seconds
        for name in wanted
    }
    session.notes.append(", ".join(f"{name} {rate:.1f}" for name, rate in counted.items()))
    for name, (least, most) in wanted.items():
        if not least <= counted[name] <= most:
            raise DepartureError(
                f"expected {least:g} to {most:g} {name} a second, counted {counted[name]:.2f}"
            )


def text(session: Session, begin: str, within_s: float = 3.0, link: str = "API") -> None:
    """A STATUSTEXT begins so, on a link with a ground station."""

    def come() -> bool:
        return any(one.startswith(begin) for one in session.texts(LinkKind(link)))

    if not session.run(within_s, come):
        raise DepartureError(
            f"expected the text '{begin}', received {session.texts(LinkKind(link))}"
        )


def event(session: Session, name: str, within_s: float = 3.0, argument: int | None = None) -> None:
    """An EVENT comes, by PX4's name of it; its first argument as a byte."""
    fields: Fields = {"id": event_id(name)}
    if argument is not None:
        fields["arguments"] = bytes((argument,))
    expect(session, "EVENT", fields, within_s)


def mode(
    session: Session,
    name: str,
    within_s: float = 2.5,
    intended: str | None = None,
    **beat: Any,
) -> None:
    """HEARTBEAT shows a mode within some seconds; others before it do not matter.

    Args:
        session: With the vehicle.
        name: Of a `FlightMode`.
        within_s: How long to wait.
        intended: CURRENT_MODE.intended_custom_mode's mode.
        beat: What else the HEARTBEAT shows: armed, system_status.
    """
    expect(session, "HEARTBEAT", {"mode": name} | beat, within_s, since_s=session.now_s)
    if intended is None:
        return

    def shown() -> bool:
        current = session.newest("CURRENT_MODE")
        return current is not None and same(current, {"intended": intended})

    if not session.run(2.5, shown):
        now = session.newest("CURRENT_MODE")
        raise DepartureError(f"expected {intended} intended, CURRENT_MODE is {now}")


def stays_in(session: Session, name: str, for_s: float) -> None:
    """The mode does not change for some seconds."""
    mode(session, name)
    session.mark()
    session.run(for_s)
    seen = {mode_name(beat.fields["custom_mode"]) for beat in session.since("HEARTBEAT")}
    if seen - {name}:
        raise DepartureError(f"expected {name} for {for_s:g} s, saw {sorted(seen)}")


def mission(session: Session, fields: Fields, within_s: float = 2.5) -> None:
    """MISSION_CURRENT becomes so within some seconds.

    Its mission_state: 1 none, 2 not started, 3 active, 4 paused, 5 complete; mission_mode: 1
    active, 2 suspended.
    """
    expect(session, "MISSION_CURRENT", fields, within_s, since_s=session.now_s)


def disarmed(session: Session, between_s: Sequence[float]) -> None:
    """HEARTBEAT shows that the motors stopped, after a number of seconds within limits."""
    begun_s = session.now_s

    def stopped() -> bool:
        beat = session.newest("HEARTBEAT")
        return beat is not None and same(beat, {"armed": False})

    done = session.run(between_s[1], stopped)
    took_s = session.now_s - begun_s
    session.notes.append(f"disarmed after {took_s:.1f} s" if done else "not disarmed")
    if not done or took_s < between_s[0]:
        limits = f"{between_s[0]:g} to {between_s[1]:g}"
        raise DepartureError(f"expected disarming after {limits} s, {session.notes[-1]}")


def same(fields: Fields, wanted: Fields) -> bool:
    """Whether a message has the wanted values."""
    return all(_equal(_reading(fields, name), name, value) for name, value in wanted.items())


def shorten(fields: Fields, wanted: Iterable[str]) -> Fields:
    """The fields that matter; all of them if none is wanted."""
    return {name: _reading(fields, name) for name in wanted} or fields


def _matching(
    session: Session, name: str, fields: Fields | None, link: str = "API"
) -> list[ReceivedMessage]:
    return [
        one for one in session.since(name, link=LinkKind(link)) if same(one.fields, fields or {})
    ]


def _reading(fields: Fields, name: str) -> Any:
    return fields[name] if name in fields else _READINGS[name](fields)


def _equal(value: Any, name: str, wanted: Any) -> bool:
    if name == "command":
        return bool(value == command_number(wanted))
    if isinstance(wanted, bytes):
        return bytes(value).startswith(wanted)
    if isinstance(wanted, float):
        return math.isclose(value, wanted, rel_tol=1e-5, abs_tol=1e-3)
    return bool(value == wanted)


def arrives(
    session: Session, place: Sequence[float | None], near_m: float = 2.0, within_s: float = 60.0
) -> None:
    """The vehicle comes near a place, metres north, east and up.

    An axis that is None or not given does not matter.
    """

    def near() -> bool:
        axes = zip(place, session.position[1:], strict=False)
        return math.hypot(*(wanted - is_ for wanted, is_ in axes if wanted is not None)) <= near_m

    if not session.run(within_s, near):
        raise DepartureError(
            f"expected it within {near_m:g} m in {within_s:g} s, it is at {session.position}"
        )


@dataclass(frozen=True)
class Measure:
    """Something measured while it flies for some seconds, to be compared with limits.

    Attributes:
        of: The measure, from the positions before and during that time.
        note: Its text in the notes.
    """

    of: Callable[[Sequence[PositionEstimate]], float]
    note: str

    def __call__(self, session: Session, between: Sequence[float], for_s: float) -> None:
        """Measure it.

        Raises:
            DepartureError: it is not within the limits.
        """
        start, first = session.position, len(session.track)
        session.run(for_s)
        track = [start, *session.track[first:]]
        value = self.of(track)
        session.notes.append(self.note.format(value, track[-1]))
        if not between[0] <= value <= between[1]:
            limits = f"{between[0]:g} to {between[1]:g}"
            raise DepartureError(f"expected {limits} in {for_s:g} s, it {session.notes[-1]}")


def _strayed_m(track: Sequence[PositionEstimate]) -> float:
    return max(math.dist(track[0].level_m, place.level_m) for place in track)


def _speed_m_s(track: Sequence[PositionEstimate]) -> float:
    flown = track[1:]
    way_m = sum(math.dist(a.level_m, b.level_m) for a, b in itertools.pairwise(flown))
    return way_m / max(flown[-1].at_s - flown[0].at_s, 0.1)


def _climb_m_s(track: Sequence[PositionEstimate]) -> float:
    start, end = track[0], track[-1]
    return (end.up_m - start.up_m) / max(end.at_s - start.at_s, 0.1)


strays: Final = Measure(_strayed_m, "left its place by {:.1f} m")
speed: Final = Measure(_speed_m_s, "{:.1f} m/s")
climb: Final = Measure(_climb_m_s, "climbed {:.2f} m/s")
furthest_north: Final = Measure(
    lambda track: max(place.north_m for place in track[1:]), "came {:.1f} m north, is at {}"
)


_TURN_CHECK_S: Final = 0.2  # within which the nose turns less than half a turn


def turns(session: Session, between_deg: Sequence[float], for_s: float) -> None:
    """The nose turns clockwise by so many degrees in some seconds, least and most."""
    turned_deg, heading_deg = 0.0, _heading_deg(session)
    end_s = session.now_s + for_s
    while session.now_s < end_s:
        session.run(_TURN_CHECK_S)
        before_deg, heading_deg = heading_deg, _heading_deg(session)
        turned_deg += math.remainder(heading_deg - before_deg, 360.0)
    session.notes.append(f"turned by {turned_deg:.0f} deg")
    if not between_deg[0] <= turned_deg <= between_deg[1]:
        limits = f"{between_deg[0]:g} to {between_deg[1]:g} deg"
        raise DepartureError(f"expected {limits} in {for_s:g} s, it {session.notes[-1]}")


def _heading_deg(session: Session) -> float:
    attitude = session.newest("ATTITUDE")
    if attitude is None:
        raise DepartureError("expected ATTITUDE, received none")
    return math.degrees(attitude["yaw"])
