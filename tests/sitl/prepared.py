"""A vehicle of our own at the start of a conversation; getting there is the same for many."""

import copy
import copyreg
import struct
from functools import cache

from sitl.conformance.conversation import Conversation, Start, prepare
from sitl.conformance.session import Link, LocalLine, Session
from sitl.mavlink.telemetry import ONBOARD_RATES_HZ
from sitl.mavlink.vehicle import STEP_S, VehicleSettings
from sitl.px4sim.state import Place
from sitl.px4sim.versions import USUAL

HOME = Place(47.397742, 8.545594, 489.4)
SLOWER_HZ = {name: min(rate_hz, 10.0) for name, rate_hz in ONBOARD_RATES_HZ.items()}

copyreg.pickle(struct.Struct, lambda one: (struct.Struct, (one.format,)))  # also to copy it


def local_line(links=frozenset({Link.API}), *, px4s_own=False, speed=1.0, version=USUAL):
    """To a vehicle in half as many steps and with fewer messages, unless it matters."""
    quick = {} if px4s_own else {"step_s": 2 * STEP_S, "onboard_rates_hz": SLOWER_HZ}
    own = {"ground_link": Link.GROUND in links, "version": version}
    return LocalLine(VehicleSettings(*(HOME, 1, 1, speed, 1.7e9), **own, **quick))


@cache
def _ready(start, parameters, links, px4s_own, version):
    session = Session(local_line(links, px4s_own=px4s_own, version=version), version)
    prepare(Conversation("test", "a fact", "here", (), start, dict(parameters), links), session)
    return session


def ready_for(
    start=Start.GROUND, parameters=None, links=frozenset({Link.API}), *, steps=(), version=USUAL
):
    """A session of its own with a vehicle that waits for the first step."""
    px4s_own = any("rates" in step for step in steps)
    given = tuple((parameters or {}).items())
    return copy.deepcopy(_ready(start, given, links, px4s_own, version))
