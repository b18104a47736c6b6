"""Goals of ROS 2 actions: what the flight's changes of state make of them."""

import base64

import pytest

from air_router.ros2.actions import ANY, GOTO, SEEK, Cancel, Goals, Status

ID, OTHER = (base64.b64encode(bytes([number] * 16)).decode() for number in (1, 2))


def changes(*moves, first=1):
    return [
        {"number": number, "left": left, "signal": signal, "why": signal.lower(), "state": state}
        for number, (left, signal, state) in enumerate(moves, first)
    ]


SENT, SOUGHT = ("EXPL", "GOTO", "GOTO"), ("EXPL", "SEEK", "SEARCH")


@pytest.mark.parametrize(
    ("course", "moves", "status", "message"),
    [
        (GOTO, [], Status.EXECUTING, ""),
        (GOTO, [SENT], Status.EXECUTING, ""),
        (GOTO, [SENT, ("GOTO", "TIMER", "EXPL")], Status.SUCCEEDED, GOTO.reached),
        (GOTO, [SENT, ("GOTO", "NO_WAY", "EXPL")], Status.ABORTED, "GOTO -> EXPL: no_way"),
        (GOTO, [SENT, ("GOTO", "GOTO", "GOTO")], Status.ABORTED, "GOTO -> GOTO: goto"),
        (GOTO, [("SEARCH", "TIMER", "EXPL"), SENT], Status.EXECUTING, ""),
        (SEEK, [SOUGHT, ("SEARCH", "FOUND", "COMM")], Status.EXECUTING, ""),
        (
            SEEK,
            [SOUGHT, ("SEARCH", "FOUND", "COMM"), ("COMM", "SYNCED", "EXPL")],
            Status.SUCCEEDED,
            SEEK.reached,
        ),
        (
            SEEK,
            [SOUGHT, ("SEARCH", "FOUND", "COMM"), ("COMM", "TIMER", "EXPL")],
            Status.ABORTED,
            "COMM -> EXPL: timer",
        ),
        (SEEK, [SOUGHT, ("SEARCH", "TIMER", "EXPL")], Status.ABORTED, "SEARCH -> EXPL: timer"),
    ],
)
def test_the_signal_out_of_its_states_decides_a_goal_s_status(course, moves, status, message):
    goals = Goals(course)
    goal = goals.begin(ID, 10.0, since=3)
    latest = changes(("INIT", "SEEK", "SEARCH"), ("SEARCH", "GOTO", "GOTO"), SENT, *moves)
    for _ in range(2):  # a change that is repeated counts once
        goals.follow(latest)
    assert (goal.status, goal.message) == (status, message)


def test_whom_a_request_to_cancel_means():
    goals = Goals(GOTO)
    old, new = goals.begin(ID, 10.0, 0), goals.begin(OTHER, 20.0, 0)
    assert goals.begin(ID, 30.0, 0) is None
    assert goals.to_cancel(ANY, 0.0) == (Cancel.DONE, [old, new])
    assert goals.to_cancel(ANY, 10.0) == (Cancel.DONE, [old])
    assert goals.to_cancel(OTHER, 0.0) == (Cancel.DONE, [new])
    assert goals.to_cancel("another's", 0.0) == (Cancel.UNKNOWN_GOAL, [])
    old.end(Status.CANCELED, "it stops")
    assert goals.to_cancel(ID, 0.0) == (Cancel.ENDED, [])
    assert goals.to_cancel(ANY, 0.0) == (Cancel.DONE, [new])


def test_old_results_are_forgotten_and_what_is_under_way_is_not():
    goals = Goals(GOTO)
    active = goals.begin("active", 0.0, 0)
    for number in range(100):
        goals.begin(str(number), float(number), 0).end(Status.ABORTED, "refused")
    assert len(goals.goals) == 33
    assert goals.goals["active"] is active
    assert "99" in goals.goals
