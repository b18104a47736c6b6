"""What every step of a conversation does.

A step is a mapping, as the case files have it. Its first entry is a verb and what it is about;
the others are named terms of the function that the verb stands for:

    {mode: AUTO_LOITER, armed: true}  ->  expecting.mode(session, "AUTO_LOITER", armed=True)
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final

from sitl.conformance import expecting, sending, transfers
from sitl.conformance.line import SilentVehicleError
from sitl.conformance.session import DepartureError, Session

Step = Mapping[str, Any]

VERBS: Final[Mapping[str, Callable[..., None]]] = {
    "send": sending.send,
    "command": sending.command,
    "set mode": sending.set_mode,
    "take off": sending.take_off,
    "go to": sending.goto,
    "setpoints": sending.setpoints,
    "global setpoints": sending.global_setpoints,
    "sticks": sending.sticks,
    "stop": sending.stop,
    "heartbeats": sending.heartbeats,
    "wait": sending.wait,
    "mark": sending.mark,
    "upload": transfers.upload,
    "download": transfers.download,
    "clear": transfers.clear,
    "set parameter": transfers.set_parameter,
    "parameter": transfers.parameter,
    "all parameters": transfers.all_parameters,
    "expect": expecting.expect,
    "nothing": expecting.nothing,
    "count": expecting.count,
    "rates": expecting.rates,
    "text": expecting.text,
    "event": expecting.event,
    "mode": expecting.mode,
    "stays in": expecting.stays_in,
    "mission": expecting.mission,
    "disarmed": expecting.disarmed,
    "arrives": expecting.arrives,
    "strays": expecting.STRAYS,
    "furthest north": expecting.FURTHEST,
    "speed": expecting.SPEED,
    "climb": expecting.CLIMB,
}


def run_steps(session: Session, steps: Iterable[Step]) -> None:
    """Say and expect what the steps say.

    Raises:
        DepartureError: the vehicle did something else; the message begins with the step.
        SilentVehicleError: it says nothing any more; likewise.
    """
    for step in steps:
        (verb, about), *terms = step.items()
        try:
            VERBS[verb](session, about, **dict(terms))
        except (DepartureError, SilentVehicleError) as error:
            raise type(error)(f"{verb} {'' if about is None else about}: {error}") from None
