import pytest

from sitl.experiment.model.event_queue import Agenda


def test_things_happen_in_order_of_time_and_then_of_asking():
    agenda, seen = Agenda(), []
    agenda.at(2.0, lambda: seen.append("c"))
    agenda.at(1.0, lambda: seen.append("a"))
    agenda.at(1.0, lambda: (seen.append("b"), agenda.at(0.5, lambda: seen.append("late"))))
    agenda.at(3.0, lambda: seen.append("never"))
    agenda.run(3.0)
    assert seen == ["a", "b", "late", "c"]
    assert agenda.now_s == 3.0


def test_what_recurs_does_not_drift():
    agenda, times = Agenda(), []
    agenda.every(0.1, lambda: times.append(agenda.now_s))
    agenda.run(100.05)
    assert len(times) == 1001
    assert times[-1] == 100.0


def test_times_are_whole_microseconds():
    agenda, seen = Agenda(), []
    agenda.after(0.3333334, lambda: seen.append(("asked first", agenda.now_s)))
    agenda.after(1 / 3, lambda: seen.append(("a hair sooner", agenda.now_s)))
    agenda.run(1.0)
    assert seen == [("asked first", 0.333333), ("a hair sooner", 0.333333)]
    with pytest.raises(ValueError, match="every 0"):
        agenda.every(0.0, lambda: None)
