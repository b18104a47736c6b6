"""A vehicle of our own at the start of a conversation; getting there is the same for many."""

import copy
import copyreg
import struct
from functools import cache

from sitl.conformance.conversation import Conversation, Start, prepare
from sitl.conformance.session import LinkKind, LocalLine, Session
from sitl.mavlink.telemetry import ONBOARD_RATES_HZ
from sitl.mavlink.vehicle import STEP_S, VehicleSettings
from sitl.px4sim.state import StartPosition
from sitl.px4sim.versions import USUAL

HOME = StartPosition(47.397742, 8.545594, 489.4)
SLOWER_HZ = {name: min(rate_hz, 10.0) for name, rate_hz in ONBOARD_RATES_HZ.items()}

copyreg.pickle(struct.Struct, lambda one: (struct.Struct, (one.format,)))  # also to copy it


def local_line(
    links=frozenset({LinkKind.API}), *, px4s_own=False, speed=1.0, version=USUAL, started_with=()
):
    """To a vehicle in half as many steps and with fewer messages, unless it matters."""
    quick = {} if px4s_own else {"step_s": 2 * STEP_S, "onboard_rates_hz": SLOWER_HZ}
    own = {"ground_link": LinkKind.GROUND in links, "version": version}
    on_board = {"parameters": dict(started_with)}
    return LocalLine(VehicleSettings(*(HOME, 1, 1, speed, 1.7e9), **own, **on_board, **quick))


@cache
def _ready(start, links, px4s_own, version, on_board):
    parameters, started_with = on_board
    line = local_line(links, px4s_own=px4s_own, version=version, started_with=started_with)
    session = Session(line, version)
    prepare(
        Conversation("test", "a fact", "here", (), start, dict(parameters), links=links), session
    )
    return session


def ready_for(
    start=Start.GROUND, parameters=None, links=frozenset({LinkKind.API}), *, steps=(), version=USUAL
):
    """A session of its own with a vehicle that waits for the first step."""
    return ready_to_hold(
        Conversation("test", "a fact", "here", steps, start, parameters or {}, links=links), version
    )


def ready_to_hold(one, version=USUAL):
    """The same at the start of a conversation."""
    px4s_own = any("rates" in step for step in one.steps)
    on_board = tuple(tuple(each.items()) for each in (one.parameters, one.started_with))
    return copy.deepcopy(_ready(one.start, one.links, px4s_own, version, on_board))
