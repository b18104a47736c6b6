"""What the simulated autopilot does beyond the recorded conversations (test_conformance)."""

import math
from pathlib import Path

import pytest

from sitl.conformance.conversation import Start, cases_of, run_steps
from sitl.px4sim.flight_modes import Sticks, shaped
from sitl.px4sim.motion.disturbances import EstimateErrors
from tests.sitl.prepared import ready_for

CASES = tuple(cases_of(Path(__file__).with_name("cases.yaml").read_text("utf-8")))


@pytest.mark.parametrize("one", CASES, ids=lambda one: one.name)
def test_our_autopilot(one):
    run_steps(ready_for(one.start, one.parameters, one.links, steps=one.steps), one.steps)


def test_sticks_are_shaped_with_a_dead_zone_and_out_of_range_in_the_middle():
    assert shaped(0.09) == shaped(-0.05) == 0.0
    assert shaped(1.0) == pytest.approx(1.0)
    assert shaped(-1.0) == pytest.approx(-1.0)
    assert 0 < shaped(0.5) < 0.5
    session = ready_for()
    session.send("MANUAL_CONTROL", x=2000, y=-500, z=1000, r=500)
    assert session.line.vehicle.autopilot.modes.pilot.sticks == Sticks(0.0, -0.5, 1.0, 0.5)


def test_home_is_where_it_was_armed():
    session = ready_for()
    situation = session.line.vehicle.autopilot.situation
    assert situation.home == pytest.approx((0, 0), abs=0.5)
    run_steps(session, [{"command": "COMPONENT_ARM_DISARM", "params": (1,)}])
    assert situation.home == pytest.approx((situation.north_m, situation.east_m), abs=0.2)


def test_a_jump_of_the_estimate_moves_the_vehicle():
    session = ready_for(Start.AIR)
    autopilot = session.line.vehicle.autopilot
    autopilot.errors.jump(6.0, 0.0)
    assert autopilot.errors.resets == 1
    session.run(10)
    assert autopilot.airframe.north_m == pytest.approx(-6.0, abs=1.5)  # it believes to be back


def test_the_estimate_is_near_the_truth_and_the_seed_decides_how():
    def errors(seed):
        errors = EstimateErrors(seed)
        for _ in range(10_000):
            errors.step(0.02, in_air=True)
            yield errors.north_m

    sizes = [*errors(1)]
    assert sizes == [*errors(1)] != [*errors(2)]
    assert 0.05 < math.sqrt(sum(size * size for size in sizes) / len(sizes)) < 0.2


@pytest.mark.parametrize("mode", ["AUTO_LOITER", "AUTO_MISSION", "AUTO_RTL", "AUTO_LAND"])
@pytest.mark.parametrize(
    ("version", "parameters", "position"),
    [
        ((1, 17), {"COM_RC_OVERRIDE": 1}, True),
        ((1, 17), {"COM_RC_OVERRIDE": 0}, False),
        ((1, 18), {"MAN_OVERRIDE_SPD": 1.0}, True),
        ((1, 18), {"MAN_OVERRIDE_SPD": -1.0}, False),
    ],
)
def test_moved_sticks_take_every_automatic_mode_over_if_they_may(
    mode, version, parameters, position
):
    session = ready_for(Start.AIR, parameters, version=version)
    run_steps(
        session,
        [
            {"upload": [{"at": (60, 0)}]},
            {"mission": {"mission_state": 2}},
            {"set mode": mode},
            {"sticks": {}},
            {"wait": 1.0},
            {"sticks": {"x": 600}, "over_s": 0.3},
            {"mode": "POSCTL" if position else mode},
        ],
    )
    assert ("Pilot took over using sticks" in session.texts()) is position
