"""A flight whose program stalled on a busy machine is no result of its mission."""

import json
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from air_router.controller.limits import LAG_HOLD_S
from air_router.controller.model.actions import StateChanged
from air_router.controller.model.events import CompanionLagged
from air_router.controller.model.states import Signal, State
from air_router.errors import AirRouterError
from air_router.record.recorder import Recorder
from sitl.experiment.engine import flights

UNIX_S = 1.7e9
LONG_S = 1.5 * LAG_HOLD_S
SHORT, LONG = CompanionLagged(0.9 * LAG_HOLD_S), CompanionLagged(LONG_S)
STARVED = CompanionLagged(LONG_S, within_s=10.0)
WORLD = {"robots": {"io": {"syncs": {}, "policy_fault": None}}, "goals": {"total": 0, "found": []}}


@pytest.fixture
def flown(tmp_path, monkeypatch):
    """Runs a flight whose program stalls at these seconds of a mission from 10 to 110 s."""

    def fly(stalls):
        with Recorder(tmp_path, "mission.yaml", unix_s=lambda: UNIX_S) as recorder:
            changes = {10.0: (State.READY, State.INIT), 110.0: (State.INIT, State.HOME)}
            for now_s in sorted({*stalls, *changes}):
                if now_s in stalls:
                    recorder.event(stalls[now_s], now_s)
                else:
                    source, target = changes[now_s]
                    changed = StateChanged(source, Signal.TIMER, target, None)
                    recorder.actions((changed,), now_s)
        stdout = json.dumps({"record": str(recorder.path), "world": WORLD})

        def run(*_, **__):
            time.sleep(0.02)  # two ticks of `os.times`: a flight takes some time
            return SimpleNamespace(returncode=0, stdout=stdout, stderr="")

        monkeypatch.setattr(flights.subprocess, "run", run)
        return flights.flown_in_processes(Path("mission.yaml"), 7, "round_robin", px4=True)

    return fly


@pytest.mark.parametrize("lag", [LONG, STARVED])
def test_a_flight_held_for_a_stall_or_starved_is_an_error_that_names_the_remedy(flown, lag):
    with pytest.raises(AirRouterError, match=rf"stalled for {LONG_S:.1f} s.*--jobs 1"):
        flown({40.0: lag, 60.0: SHORT})


@pytest.mark.parametrize("stalls", [{5.0: LONG}, {40.0: SHORT}])
def test_a_stall_on_the_ground_or_a_short_one_disturbs_no_flight(flown, stalls):
    assert flown(stalls).measures["mission_s"] == pytest.approx(100.0)
