"""The judge's verdict on programs that are not flown as they should be."""

import os
import socket
import sys
from pathlib import Path

import pytest

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


@pytest.mark.parametrize(
    ("printed", "outcome"),
    [
        ('{"outcome": "landed at home"}', "landed at home"),
        ('starting\n{"outcome": "waits"}\n{"outcome": "landed at home"}\n', "landed at home"),
        ('{"outcome": "landed at home"}\n[1]\n"bye"\n3\nbye {\n\n', "landed at home"),
        ("[1]\nnull\n", ""),
        ("", ""),
    ],
)
def test_a_companion_s_outcome_is_that_of_the_last_json_object_of_what_it_printed(
    tmp_path, printed, outcome
):
    prints = (sys.executable, "-c", f"print({printed!r}, end='')")
    companion = Companion(prints, [], tmp_path, lambda: 0.0)
    companion.process.wait()
    companion.close()
    assert companion.outcome == outcome
