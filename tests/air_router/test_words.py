"""Words for numbers, times and progress."""

from air_router.words import duration_text, progress_text


def test_progress_has_how_long_the_rest_takes():
    assert "left" not in progress_text(0, 8, "runs", 0.0)
    assert "left" not in progress_text(8, 8, "runs", 7.0)
    shown = "[######..................] 2 of 8 runs, about 21 s left"
    assert progress_text(2, 8, "runs", 7.0) == shown


def test_a_duration_has_the_unit_that_suits_it():
    assert [duration_text(t) for t in (30, 600, 9000)] == ["30 s", "10 min", "2.5 h"]
