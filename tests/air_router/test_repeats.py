"""Repeated lines are counted; when their counts are reported."""

import pytest

from air_router.repeats import PAUSE_S, REPORT_S, Repeats, times


def reported(repeats, now_s):
    return list(repeats.due(now_s))


def test_a_round_of_lines_is_printed_once_and_then_counted():
    repeats, full = Repeats(), []
    for step in range(39):
        line = "ABC"[step % 3]
        if not repeats.again(line, 2.0 * step):
            full.append(line)
        if 2.0 * step < REPORT_S:
            assert reported(repeats, 2.0 * step) == []
    assert full == ["A", "B", "C"]
    assert reported(repeats, 78.0) == [("A", 12), ("B", 12), ("C", 12)]
    assert reported(repeats, 78.0) == []
    assert repeats.again("A", 79.0) == 13  # in all


def test_after_a_pause_the_count_is_reported_and_then_the_line_is_printed_in_full():
    repeats = Repeats()
    assert [repeats.again("A", t) for t in (0.0, PAUSE_S, 2 * PAUSE_S)] == [0, 1, 2]
    over_s = 3.1 * PAUSE_S
    assert reported(repeats, over_s) == [("A", 2)]
    assert repeats.again("A", over_s) == 0


@pytest.mark.parametrize("line", ["A", ("A", 1)])
def test_at_the_end_and_after_a_reboot_every_count_is_reported(line):
    repeats = Repeats()
    for t in (100.0, 101.0):
        repeats.again(line, t)
    assert reported(repeats, 5.0) == [(line, 1)]  # the vehicle's clock began anew
    assert repeats.again(line, 5.0) == 0
    repeats.again(line, 6.0)
    assert reported(repeats, float("inf")) == [(line, 1)]


def test_lines_that_never_come_again_are_forgotten_and_those_that_do_are_not():
    repeats = Repeats()
    counts = []
    for step in range(1000):
        repeats.again(f"number {step}", 0.1 * step)
        counts.append(repeats.again("steady", 0.1 * step))
    assert counts == list(range(1000))


def test_after_an_alarm_or_a_reply_a_line_is_printed_in_full():
    repeats = Repeats()
    assert [repeats.again("A", t) for t in (0.0, 1.0)] == [0, 1]
    repeats.clear()
    assert reported(repeats, float("inf")) == []
    assert [repeats.again("A", t) for t in (2.0, 3.0)] == [0, 1]


def test_counts_as_text():
    assert (times(1), times(12)) == ("again", "again 12 times")
