"""What the judge says of programs that are not flown as they should be."""

import os
import socket
from pathlib import Path

from sitl.rehearsal.faults import Fault
from sitl.rehearsal.judge.verdict import judge
from sitl.rehearsal.programs.flight import RealFlight
from sitl.rehearsal.programs.processes import Companion
from sitl.rehearsal.programs.scenes import WireScene

PENNOVATION = Path(__file__).parents[4] / "missions" / "pennovation" / "mission.yaml"


def test_a_companion_that_does_not_fly_is_not_good_whatever_would_have_gone_wrong():
    scene = WireScene(Fault.DISARMED, 0)
    verdict = judge(RealFlight(scene, PENNOVATION, companion=("false",)).fly())
    assert not verdict.good
    assert verdict.faults == {"NONE"}


def test_a_companion_that_is_closed_twice_takes_no_other_flight_s_socket(tmp_path):
    companion = Companion(("true",), [], tmp_path, lambda: 0.0)
    companion.close()
    with socket.socket() as one, socket.socket() as other:
        companion.close()
        for each in (one, other):
            os.fstat(each.fileno())
