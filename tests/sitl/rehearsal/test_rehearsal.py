"""A small part of `make rehearse`: the real flight program in simulated time."""

import asyncio
import math
import pickle
from collections import Counter
from functools import cache
from pathlib import Path

import pytest

from air_router.vehicle.px4.versions import FLOWN, NEWEST
from sitl.cli.cli import main
from sitl.cli.rehearse_command import fly, table
from sitl.rehearsal.companion import SimulatedLoop, World
from sitl.rehearsal.courses import PHASES, ScheduledFault
from sitl.rehearsal.faults import Fault, Scene, scenes
from sitl.rehearsal.judge.acceptance import ACCEPTED, End
from sitl.rehearsal.judge.case import Violation
from sitl.rehearsal.judge.evidence import SceneEventKind
from sitl.rehearsal.judge.verdict import Verdict, judge
from sitl.rehearsal.simulated_flight import SimulatedFlight

VALUE = {"pilot": "AUTO_LOITER", "kill": None, "reboot": 1.0, "disarm": True}
LAST = tuple(VALUE)
PENNOVATION = Path(__file__).parents[3] / "missions" / "pennovation" / "mission.yaml"


@cache
def flown(fault, seed):
    """The evidence of a flight, for all that look at the same one."""
    return SimulatedFlight(Scene(fault, seed), PENNOVATION).fly()


@pytest.mark.parametrize(
    ("fault", "seed", "end"),
    [
        (Fault.PILOT, 2, End.PILOT),
        (Fault.UPLOAD, 1, End.STAYED),
        (
            Fault.TWO,
            298,
            End.STAYED,
        ),  # no answer to the start is received, and it is not tried again
        (Fault.DIVERTED, 4, End.PILOT),  # the first go-to is out of its fence, and refused
        (Fault.LOSS_20, 1, End.LANDED),  # the start shows in the instant in which its time is over
    ],
)
def test_the_real_program_brings_it_home_or_leaves_it_to_the_pilot(fault, seed, end):
    verdict = judge(flown(fault, seed))
    assert verdict.good, [*map(str, verdict.violations)]
    assert verdict.end is end


def test_the_same_seed_is_the_same_flight():
    before = flown(Fault.TWO, 298)
    again = SimulatedFlight(Scene(Fault.TWO, 298), PENNOVATION).fly()
    assert again.samples == before.samples
    first, second = (
        [(m.time_s, m.name, m.delivered) for m in flight.messages] for flight in (before, again)
    )
    assert first == second
    assert again.lines == before.lines


def test_a_flight_that_cannot_be_flown_is_not_good(tmp_path):
    verdict = fly(tmp_path / "none.yaml", Scene(Fault.NONE, 0))
    assert (verdict.good, verdict.end) == (False, End.NOT)


def test_a_companion_that_stands_still_sends_nothing_and_goes_on_later():
    evidence = flown(Fault.STOPPED, 2)
    assert judge(evidence).good
    stopped, going = (
        next(h.time_s for h in evidence.happenings if h.what is what)
        for what in (SceneEventKind.STOPPED, SceneEventKind.CONTINUED)
    )
    assert going > stopped
    sent_s = [m.time_s for m in evidence.messages if m.component == 191]
    assert not [at_s for at_s in sent_s if stopped < at_s < going]
    assert max(sent_s) > going
    samples = [s for s in evidence.samples if stopped < s.time_s < going]
    assert len(samples) == pytest.approx((going - stopped) * 25, abs=2)


def test_a_companion_that_stood_still_for_more_than_a_minute_goes_on(monkeypatch):
    monkeypatch.setattr(Scene, "schedule", lambda _: [ScheduledFault(5.0, "stall", 75.0, "INIT")])
    verdict = judge(SimulatedFlight(Scene(Fault.STOPPED, 0), PENNOVATION).fly())
    assert (verdict.violations, verdict.end) == ((), End.LANDED)


def test_a_pilot_who_takes_it_while_the_companion_stands_still_keeps_it(monkeypatch):
    happen = [ScheduledFault(9.2, "stall", 12.0, "COMM")]
    happen += [ScheduledFault(14.8, "pilot", "AUTO_LAND", "COMM")]
    monkeypatch.setattr(Scene, "schedule", lambda _: happen)
    verdict = judge(SimulatedFlight(Scene(Fault.PILOT, 111), PENNOVATION).fly())
    assert (verdict.violations, verdict.end) == ((), End.PILOT)


def test_whatever_can_happen_happens(monkeypatch):
    """Every fault that any scene has, one after the other in a single flight."""
    kinds = {m.what: m for s in scenes() for m in s.schedule() if m.what not in LAST}
    kinds |= {what: kinds.pop(what) for what in ("fix", "satellites")}  # PX4 lands without
    happen = [m._replace(at_s=30.0 + 1.0 * n, phase="armed") for n, m in enumerate(kinds.values())]
    end_s = happen[-1].at_s
    happen += [
        ScheduledFault(end_s + 3.0 * n, what, VALUE.get(what), "armed")
        for n, what in enumerate(LAST, 1)
    ]
    monkeypatch.setattr(Scene, "schedule", lambda _: list(happen))
    evidence = SimulatedFlight(Scene(Fault.NONE, 0), PENNOVATION).fly()
    happened = {h.value for h in evidence.happenings if h.what is SceneEventKind.FAULT}
    assert happened >= {*kinds, *LAST} - {"reject"}
    assert {
        SceneEventKind.PILOT,
        SceneEventKind.HOME_MOVED,
        SceneEventKind.KILLED,
        SceneEventKind.DISARMED,
    } <= {h.what for h in evidence.happenings}


def test_a_rehearsal_is_flown_with_every_version_of_px4_and_most_with_the_newest():
    flown = Counter(scene.px4 for scene in scenes())
    assert set(flown) == set(FLOWN)
    assert 0.55 < flown[NEWEST] / flown.total() < 0.7
    assert min(flown.values()) > 0.09 * flown.total()


def test_every_fault_has_flights_and_a_row_of_the_judge():
    whole = scenes()
    assert {scene.fault for scene in whole} == {fault for fault in Fault if fault.value.flights}
    assert {fault.name for fault in Fault} - {"TWO"} <= set(ACCEPTED)
    assert all(len(scene.faults) == 2 for scene in whole if scene.fault is Fault.TWO)
    assert pickle.loads(pickle.dumps(whole)) == whole  # noqa: S301 - our own


def test_faults_begin_in_every_phase_of_a_flight():
    begins = {Scene(Fault.PILOT, seed).schedule()[0].phase for seed in range(12)}
    assert begins == {*PHASES, "armed"}
    assert all(
        scheduled.at_s >= 0
        for scene in scenes()
        for scheduled in scene.schedule()
        if math.isfinite(scheduled.at_s)
    )


class Calendar(World):
    """A world in which one thing happens, at noon."""

    def __init__(self, noon_s, happen):
        super().__init__()
        self._noon_s = noon_s
        self._happen = happen

    def advance(self, until_s):
        if self.now_s < self._noon_s <= until_s:
            self.now_s = self._noon_s
            return [self._happen]
        return super().advance(until_s)


def test_a_simulated_loop_waits_without_waiting():
    received = asyncio.Event()
    loop = SimulatedLoop(Calendar(3600.0, received.set))

    async def script():
        await asyncio.sleep(1800.0)
        before_s = loop.time()
        await received.wait()
        assert await asyncio.to_thread(str, 1) == "1"
        return before_s, loop.time()

    assert loop.run_until_complete(script()) == pytest.approx((1800.0, 3600.0))
    loop.close()


def test_the_table():
    bad = (Violation(10.0, "room", "0.5 m inside"),)
    faults = frozenset({"GUSTS"})
    verdicts = [
        ("GUSTS", Verdict("GUSTS-0", faults, End.LANDED, closest_m=6.2)),
        ("GUSTS", Verdict("GUSTS-1", faults, End.NOT, bad, closest_m=-0.5)),
    ]
    text = table(verdicts, {"GUSTS": "gusty wind"})
    assert "| gusty wind | 2 | 1 | 1 | -0.5 m | 1 |" in text
    assert "**all**" in text


def test_a_rehearsal_reports_its_progress_on_stderr_and_the_table_on_stdout(capsys):
    options = ["--fault", "PILOT", "--seed", "2", "--jobs", "1"]
    assert main(["rehearse", str(PENNOVATION), *options]) == 0
    output = capsys.readouterr()
    assert "1 of 1 flight" in output.err
    assert output.out.startswith("| fault |")


@pytest.mark.parametrize(
    ("mission", "options", "code", "error"),
    [
        ("nowhere.yaml", [], 3, "nowhere.yaml"),
        (PENNOVATION, ["--fault", "PILOTS"], 2, "no fault 'PILOTS' here; did you mean PILOT"),
        (PENNOVATION, ["--mavlink", "--fault", "ZZZ"], 2, "known: "),
    ],
)
def test_what_cannot_be_rehearsed_is_one_error_and_no_flight(mission, options, code, error, capsys):
    assert main(["rehearse", str(mission), *options]) == code
    output = capsys.readouterr()
    assert error in output.err
    assert output.out == ""
