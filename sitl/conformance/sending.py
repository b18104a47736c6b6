"""The steps that say something to the vehicle, and what is answered to a command."""

import math
from collections.abc import Sequence
from typing import Any, Final

from sitl.conformance.session import COMPANION, GROUND_STATION, DepartureError, Link, Session
from sitl.mavlink.codec import command_number
from sitl.px4sim.commands import CommandResult
from sitl.px4sim.state import FlightMode

_EXTRA_S: Final = 0.3
_NO_POSITION: Final = 2**31 - 1
_SENDERS: Final = {"ground station": GROUND_STATION, "companion": COMPANION, "silent": None}


def send(session: Session, name: str, fields: dict[str, Any] | None = None) -> None:
    """Send a message; a target that is not given is the vehicle's autopilot."""
    session.mark()
    session.say(name, **(fields or {}))


def command(  # noqa: PLR0913 - what a case may say of a command
    session: Session,
    name: str | int,
    params: Sequence[float] = (),
    answers: Sequence[str] = ("ACCEPTED",),
    *,
    within_s: float = 1.0,
    target: Sequence[int] | None = None,
) -> None:
    """Send a COMMAND_LONG; COMMAND_ACKs with these results have to come, none: silence.

    Params that are missing are NaN. The target is a system and component id.
    """
    padded = (*params, *(math.nan,) * (7 - len(params)))
    fields: dict[str, Any] = {f"param{number}": value for number, value in enumerate(padded, 1)}
    if target is not None:
        fields["target_system"], fields["target_component"] = target
    send(session, "COMMAND_LONG", fields | {"command": name})
    _check_answers(session, name, answers, within_s)


def set_mode(
    session: Session,
    mode: str | tuple[int, int],
    result: str = "ACCEPTED",
    base_mode: int = 1,
) -> None:
    """Send DO_SET_MODE with a `FlightMode`, or main mode and submode.

    PX4 1.17 answers ACCEPTED first, and the result when it has decided.
    """
    main, sub = FlightMode[mode].value[:2] if isinstance(mode, str) else mode
    command(session, "DO_SET_MODE", (base_mode, main, sub), ("ACCEPTED", result))


def take_off(session: Session, up_m: float) -> None:
    """Send NAV_TAKEOFF to a height above home."""
    command(session, "NAV_TAKEOFF", (*(math.nan,) * 6, session.ground_amsl_m + up_m))


def goto(
    session: Session,
    place: Sequence[float | None],
    answer: str = "ACCEPTED",
    fields: dict[str, Any] | None = None,
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
    usual: dict[str, Any] = {
        "command": "DO_REPOSITION",
        "frame": 5,
        "param1": -1.0,
        "param2": 1.0,
        "param4": math.nan,
        "x": x,
        "y": y,
        "z": math.nan if up_m is None else up_m + session.ground_amsl_m,
    }
    send(session, "COMMAND_INT", usual | (fields or {}))
    _check_answers(session, "DO_REPOSITION", (answer,), 1.0)


def sticks(session: Session, moved: dict[str, int]) -> None:
    """Stream MANUAL_CONTROL: x (pitch), y, r -1000 to 1000, z (throttle) 0 to 1000."""
    session.sticks = {"z": 500} | moved


def stop(session: Session, _: None) -> None:
    """Stop the sticks."""
    session.sticks = None


def heartbeats(session: Session, sender: str, link: str = "API") -> None:
    """Change whose heartbeats are sent on a link; a companion has the vehicle's system id."""
    identity = _SENDERS[sender]
    if identity is None:
        session.beats.pop(Link(link), None)
    else:
        kind, system, component = identity
        own = session.vehicle_id if sender == "companion" else system
        session.beats[Link(link)] = (kind, own, component)


def wait(session: Session, seconds: float) -> None:
    """Let the vehicle's time pass."""
    session.run(seconds)


def mark(session: Session, _: None) -> None:
    """What is expected next has to come from now on."""
    session.mark()


def _check_answers(
    session: Session, name: str | int, answers: Sequence[str], within_s: float
) -> None:
    number = command_number(name)

    def results() -> list[str]:
        return [
            _result_name(heard.fields["result"])
            for heard in session.since("COMMAND_ACK")
            if heard.fields["command"] == number
        ]

    session.run(within_s, lambda: bool(answers) and len(results()) >= len(answers))
    session.run(_EXTRA_S)
    session.notes.append(f"{number}: {', '.join(results()) or 'silence'}")
    # Of DO_SET_MODE's two answers either may be first when the machine is busy.
    if sorted(results()) != sorted(answers):
        raise DepartureError(f"expected the answers {list(answers)}, heard {results()}")


def _result_name(result: int) -> str:
    return CommandResult(result).name if result in set(CommandResult) else str(result)
