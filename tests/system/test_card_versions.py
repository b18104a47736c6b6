"""The pre-flight card on every version of PX4: no parameter unreported, and no wrong one passes.

The versions are those of the simulated autopilot, and the real PX4s that PX4_SITL names.
"""

import contextlib
import json
import re
import socket
import struct
import time
from typing import NamedTuple

import pytest
from pymavlink.dialects.v20 import common as mavlink

from air_router.sim.ports import free_port
from air_router.vehicle.px4.versions import FLOWN, name_of
from tests.system.conftest import answer, hurry
from tests.system.real_px4 import PLACES, found, named_by, started

WRONG = {
    "GF_ACTION": 0,
    "GF_MAX_HOR_DIST": 100.0,
    "RTL_RETURN_ALT": 20.0,
    "COM_RC_IN_MODE": 4,
    "NAV_DLL_ACT": 5,
    "BAT_CRIT_THR": 0.3,
    "COM_RC_OVERRIDE": 0,
    "MAN_OVERRIDE_SPD": -1.0,  # in place of the one before, from 1.18 on
}
STICKS = {"COM_RC_OVERRIDE", "MAN_OVERRIDE_SPD"}
INT32, REAL32 = 6, 9  # MAV_PARAM_TYPE
SET_S = 20.0  # against hangs only


class Cards(NamedTuple):
    """The card of one vehicle.

    Attributes:
        before: Its lines by name, with the parameters as they are by default.
        after: The same with those of `WRONG`.
        wrong: Names of those of `WRONG` that this version has.
    """

    before: dict[str, dict[str, str]]
    after: dict[str, dict[str, str]]
    wrong: set[str]


def set_parameters(link, to, vehicle):
    """Set each of `WRONG`, and give the names of those that there are."""
    packer = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    parser = mavlink.MAVLink(None)
    parser.robust_parsing = True
    stored = set()
    deadline_s = time.monotonic() + SET_S
    link.settimeout(0.2)
    while len(stored) < len(WRONG) - 1 or not stored & STICKS:
        assert time.monotonic() < deadline_s, stored
        link.sendto(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(packer), to)
        for name in WRONG.keys() - stored:
            value = WRONG[name]
            whole = isinstance(value, int)
            number = struct.unpack("<f", struct.pack("<i", value))[0] if whole else value
            fields = vehicle, 1, name.encode(), number, INT32 if whole else REAL32
            link.sendto(mavlink.MAVLink_param_set_message(*fields).pack(packer), to)
        with contextlib.suppress(TimeoutError):
            for _ in range(100):  # of other messages
                for message in parser.parse_buffer(link.recv(65535)) or ():
                    if message.get_type() == "PARAM_VALUE":
                        stored |= {message.param_id} & WRONG.keys()
    return stored


def cards_of(arguments, folder):
    """Start `sitl` with these arguments, and look at its card before and after the wrong values."""
    mission = hurry(folder / "versions")
    text = re.sub(r"(?m)^accepts: .*$", "", mission.read_text(encoding="utf-8"))
    mission.write_text(text, encoding="utf-8")
    with contextlib.ExitStack() as stack:
        link = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        link.bind(("127.0.0.1", 0))
        if arguments[0] == "vehicle":
            arguments = [*arguments, f"--gcs-to=127.0.0.1:{link.getsockname()[1]}"]
            arguments += [
                f"--api-to=127.0.0.1:{free_port()}",
                f"--truth-to=127.0.0.1:{free_port()}",
            ]
        ready = stack.enter_context(started(folder, arguments[0], mission, *arguments[1:]))
        port = ready["mavlink"].rpartition(":")[2]
        system = ready["system_id"]
        seen_from = arguments[0] == "vehicle"
        to = link.recvfrom(65535)[1] if seen_from else ("127.0.0.1", 18570 + system - 1)

        def card():
            look = "preflight", mission, "--look", "--json", "--no-record", f"--sysid={system}"
            _, out, _ = answer(folder, *look, f"--connect=udpin://127.0.0.1:{port}")
            return {line["name"]: line for line in json.loads(out)["checks"]}

        before = card()
        wrong = set_parameters(link, to, system)
        after = card()
    return Cards(before, after, wrong)


OURS = [pytest.param((True, name_of(version)), id=name_of(version)) for version in FLOWN]
REAL = [pytest.param((False, *each.values), id=each.id) for each in PLACES]


@pytest.fixture(scope="module", params=[*OURS, *REAL])
def cards(request, tmp_path_factory):
    simulated, which = request.param
    folder = tmp_path_factory.mktemp("card")
    if simulated:
        return cards_of(["vehicle", f"--px4-version={which}", "--speed=10"], folder)
    found(which)
    return cards_of(["px4", *named_by(which)], folder)


def test_every_parameter_is_reported(cards):
    assert cards.before["vehicle"]["verdict"] == "ok"
    assert int(cards.before["parameters"]["found"].split()[0]) > 0
    assert not [line for line in cards.before.values() if "not reported" in line["found"]]


@pytest.mark.parametrize("name", WRONG)
def test_what_is_set_wrong_stops_the_flight(cards, name):
    if name in cards.wrong:
        assert cards.after[name]["verdict"] == "stop"
    else:  # the version has the other one
        assert cards.wrong == WRONG.keys() - {name}
        assert name in STICKS
        assert name not in cards.after
