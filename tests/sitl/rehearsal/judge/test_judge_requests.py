"""The judge of what an operator asked for: by hand, what was accepted and did not follow."""

import pytest

from sitl.rehearsal.judge.evidence import SceneEvent, SceneEventKind
from sitl.rehearsal.judge.judge_flight import judge
from tests.sitl.rehearsal.judge.test_judge import command, evidence, goto, heart, track
from tests.sitl.rehearsal.judge.test_judge_inputs import CRUISES, FLOWN, HOVERS


def found(states, verb, answer, *, more=(), later=()):
    """What is found of a flight in which that was asked for at 70 s."""
    asked = SceneEvent(70.0, SceneEventKind.REQUEST, verb)
    said = [CRUISES, (70.0, f"70.0 s  the operator: {answer}")]
    verdict = judge(evidence(states, more=more, happenings=(asked, *later), said=said))
    return {violation.kind for violation in verdict.violations}


def test_a_hold_that_was_accepted_is_flown():
    assert found(FLOWN, "hold", "accepted: it stops and hovers") == {"request"}
    assert found(HOVERS, "hold", "accepted: it stops and hovers") == set()
    leg = [goto(75.0, 60, 60)]
    assert "request" in found(HOVERS, "hold", "accepted: it stops and hovers", more=leg)


@pytest.mark.parametrize("answer", ["refused: it comes home", "accepted: it holds already"])
def test_what_was_refused_or_is_so_already_needs_not_follow(answer):
    assert found(FLOWN, "hold", answer) == set()


def test_after_a_way_home_was_accepted_something_is_sent():
    accepted = "accepted: it comes home"
    assert found(FLOWN, "home", accepted) == {"request"}
    assert found(FLOWN, "home", accepted, more=[command(71.0, 176)]) == set()
    assert found(FLOWN, "home", f"{accepted} as soon as it is known where it is") == set()


def test_the_next_request_is_another_wish():
    later = (SceneEvent(72.0, SceneEventKind.REQUEST, "explore"),)
    assert found(FLOWN, "hold", "accepted: it stops and hovers", later=later) == set()
    assert found(FLOWN, "home", "accepted: it comes home", later=later) == set()


def test_a_companion_that_is_started_anew_has_no_claim_to_another_plan():
    happenings = [
        SceneEvent(30.0, SceneEventKind.KILLED),
        SceneEvent(32.0, SceneEventKind.PILOT, "plan"),
        SceneEvent(40.0, SceneEventKind.STARTED),
    ]
    faults, more = ("RESTARTED_ON_ANOTHER",), [heart(45.0), command(50.0, 176)]
    for value, wrong in (("plan", True), ("sticks", False)):
        happenings[1] = SceneEvent(32.0, SceneEventKind.PILOT, value)
        flown = evidence(more=more, faults=faults, happenings=tuple(happenings))
        assert ("authority" in {v.kind for v in judge(flown).violations}) == wrong


@pytest.mark.parametrize("stands", [False, True])
def test_given_back_low_it_climbs_before_it_flies_on(stands):
    states = [(*s[:2], 20.0, *s[3:]) if 900 <= n < 1600 else s for n, s in enumerate(track())]
    if stands:
        states[1200:1600] = [(*states[1200][:2], *s[2:]) for s in states[1200:1600]]
    happenings = (
        SceneEvent(30.0, SceneEventKind.PILOT, "sticks"),
        SceneEvent(60.0, SceneEventKind.REQUEST, "resume"),
    )
    back = [command(61.0, 176, param2=4.0, param3=4.0)]
    verdict = judge(evidence(states, more=back, faults=("HANDED_BACK_LOW",), happenings=happenings))
    assert ("altitude" in {violation.kind for violation in verdict.violations}) != stands
