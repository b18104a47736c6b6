"""The table of what a flight rests on in which version of PX4."""

import pytest

from air_router.vehicle.px4.versions import FACTS, FLOWN, NEWEST, OLDEST, name_of, version_of


@pytest.mark.parametrize(
    ("words", "version"),
    [("1.17.0", (1, 17)), ("1.18.3", (1, 18)), ("2.0.0", (2, 0)), ("of unknown version", None)],
)
def test_the_number_of_a_version(words, version):
    assert version_of(words) == version


def test_a_version_is_written_as_people_do():
    assert [name_of(version) for version in FLOWN] == ["1.15", "1.16", "1.17", "1.18"]


def test_every_fact_holds_in_a_version_that_was_flown_and_has_a_substitute_in_the_others():
    for fact in FACTS:
        holds = [fact.holds_in(version) for version in FLOWN]
        assert any(holds), fact.fact
        assert all(holds) or fact.instead, fact.fact
        assert fact.source


def test_a_fact_holds_from_its_first_version_to_the_last_before_it_ended():
    (twice,) = (fact for fact in FACTS if "twice" in fact.fact)
    assert [twice.holds_in(version) for version in FLOWN] == [False, True, True, False]
    assert not twice.holds_in((1, NEWEST[1] + 1))
    (state,) = (fact for fact in FACTS if "mission_state" in fact.fact)
    assert (state.holds_in(OLDEST), state.holds_in(NEWEST)) == (False, True)
