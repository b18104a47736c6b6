from sitl.experiment.events import EventQueue


def test_things_happen_in_order_of_time_and_then_of_scheduling():
    queue, seen = EventQueue(), []
    queue.at(2.0, lambda: seen.append("c"))
    queue.at(1.0, lambda: seen.append("a"))
    queue.at(1.0, lambda: (seen.append("b"), queue.at(0.5, lambda: seen.append("late"))))
    queue.at(3.0, lambda: seen.append("never"))
    queue.run(3.0)
    assert seen == ["a", "b", "late", "c"]
    assert queue.now_s == 3.0


def test_what_recurs_does_not_drift():
    queue, times = EventQueue(), []
    queue.every(0.1, lambda: times.append(queue.now_s))
    queue.run(100.05)
    assert len(times) == 1001
    assert times[-1] == 100.0


def test_times_are_whole_microseconds():
    queue, seen = EventQueue(), []
    queue.after(0.3333334, lambda: seen.append(("scheduled first", queue.now_s)))
    queue.after(1 / 3, lambda: seen.append(("a hair sooner", queue.now_s)))
    queue.run(1.0)
    assert seen == [("scheduled first", 0.333333), ("a hair sooner", 0.333333)]
