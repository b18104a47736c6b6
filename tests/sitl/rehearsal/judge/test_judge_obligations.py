"""What an accepted request obliges to: the answer's own words excuse nothing."""

import pytest

from sitl.rehearsal.judge.evidence import SceneEvent, SceneEventKind
from sitl.rehearsal.judge.verdict import judge
from tests.sitl.rehearsal.judge.test_judge import FRAME, TEXT, command, goto
from tests.sitl.rehearsal.judge.test_judge_inputs import FLOWN, HOVERS, flight


def texts(*answers, states=FLOWN, more=(), said=(), happenings=(), text=TEXT):
    """Of a flight in which these were asked for: when, what, and the words of the answer."""
    asked = tuple(SceneEvent(at_s, SceneEventKind.REQUEST, verb) for at_s, verb, _ in answers)
    lines = [(43.0, "43.0 s  READY -> INIT"), (44.0, "44.0 s  INIT -> EXPL")]
    lines += [(at_s + 0.1, f"{at_s} s  the operator: {words}") for at_s, _, words in answers]
    lines += said
    happenings = asked + tuple(happenings)
    flown = flight(states, said=sorted(lines), more=more, happenings=happenings, text=text)
    return " | ".join(str(v) for v in judge(flown).violations if v.kind in {"request", "told"})


@pytest.mark.parametrize("words", ["accepted: it stops and hovers", "accepted: it holds already"])
def test_a_hold_is_held_whatever_it_is_called(words):
    assert "hold was accepted" in texts((60.0, "hold", words))
    held = [(70.0, "70.0 s  EXPL -> HOLD")]
    assert "hold was accepted" not in texts((70.0, "hold", words), states=HOVERS, said=held)


@pytest.mark.parametrize(
    ("verb", "words"),
    [
        ("seek io", "accepted: it seeks io"),
        ("home", "accepted: it comes home; it sets out once the changed zones are on board"),
        ("home", "accepted: it comes home already"),
        ("explore", "accepted: it explores already"),
    ],
)
def test_after_every_way_that_is_accepted_something_is_sent(verb, words):
    still = [*FLOWN[:1200], *[FLOWN[1200]] * 2000, *FLOWN[1200:]]
    said = [(72.0, "72.0 s  EXPL -> GOTO")]
    assert f"though {verb.split()[0]} was accepted" in texts(
        (74.0, verb, words), states=still, said=said
    )
    sent = [goto(75.0, 0, 60)]
    assert f"though {verb.split()[0]} was accepted" not in texts(
        (74.0, verb, words), states=still, more=sent, said=said
    )


def degrees(east, north):
    return ",".join(f"{angle:.7f}" for angle in FRAME.degrees(east, north))


@pytest.mark.parametrize(
    ("place", "wrong"),
    [((0, 60), False), ((-60, 20), True), ((30, 30), False), ((9, 60), False)],
)
def test_a_point_that_is_accepted_is_come_to(place, wrong):
    asked = (55.0, f"goto {degrees(*place)}", "accepted: it flies to the point")
    found = texts(asked, more=[goto(55.5, 0, 60)])
    assert ("to a point that was accepted" in found) == wrong


def test_points_in_a_zone_are_come_as_near_to_as_that_allows():
    asked = (55.0, f"goto {degrees(30, 39)}", "accepted: it flies to the point: beside it")
    over = TEXT.replace("[40, 40], [20, 40]", "[40, 59], [20, 59]")
    assert over != TEXT
    assert "to a point that was accepted" in texts(asked, more=[goto(55.5, 0, 60)])


@pytest.mark.parametrize(
    "words", ["accepted: it lands where it hovers", "accepted: it lands already"]
)
def test_a_landing_is_told(words):
    held = [(58.0, "58.0 s  EXPL -> HOLD")]
    wanted = "not told to land"
    assert wanted in texts((75.0, "land", words), states=HOVERS, said=held)
    told = [command(75.5, 21)]
    assert wanted not in texts((75.0, "land", words), states=HOVERS, said=held, more=told)


def test_a_hold_that_is_resumed_ends():
    held = [(58.0, "58.0 s  EXPL -> HOLD")]
    asked = (75.0, "resume", "accepted: it goes on")
    assert "it holds on" in texts(asked, states=HOVERS, said=held)
    on = [*held, (75.2, "75.2 s  HOLD -> EXPL")]
    assert "it holds on" not in texts(asked, states=HOVERS, said=on)


def test_points_that_wait_are_not_forgotten():
    asked = [(60.0, "goto 39.9,-75.2", "points from the operator wait until the vehicle flies on")]
    long = [*FLOWN[:1400], *[FLOWN[1400]] * 3000, *FLOWN[1400:]]
    assert "forgotten" in texts(*asked, states=long)
    later = [(90.0, "90.0 s  the operator: accepted: it flies to the point")]
    assert "forgotten" not in texts(*asked, states=long, said=later)


@pytest.mark.parametrize(
    ("drawn", "wrong"), [("", True), ("{centre: [60, 100], radius_m: 9}", True), ("near", False)]
)
def test_only_what_is_new_and_near_is_left(drawn, wrong):
    at_s = 60.0  # at (0, 45), on its way home
    near = "{centre: [0, 35], radius_m: 9}"
    zone = f"  - {{circle: {near if drawn == 'near' else drawn}}}\n" if drawn else ""
    new = (SceneEvent(at_s - 1.0, SceneEventKind.MISSION_FILE, TEXT + zone),) if drawn else ()
    found = texts(said=[(at_s, "60.0 s  leaving no-fly zone 'x'")], happenings=new)
    assert ("nothing new is near" in found) == wrong


def test_what_comes_home_by_its_own_words_lands():
    long = [*FLOWN[:1400], *[FLOWN[1400]] * 3000, *FLOWN[1400:]]
    said = [(65.0, "65.0 s  coming home: battery at 25%")]
    flown = flight(long, said=said)
    assert "it says that it comes home" in str(judge(flown).violations)


@pytest.mark.parametrize(
    ("climb_m_s", "found"), [(0.0, ""), (1.0, "it climbs by"), (-1.0, "it sinks by")]
)
def test_a_hold_ends_a_climb_too(climb_m_s, found):
    """Held at 72 s, where it stands, it stays at 40 m, or goes on up or down from there."""
    states = [
        (east, north, height + climb_m_s * min(max(n * 0.05 - 72.0, 0.0), 9.0), *rest)
        for n, (east, north, height, *rest) in enumerate(HOVERS[:1800])
    ]
    text = f"{TEXT}altitudes_m: [25, 60]\n"
    held = [(72.2, "72.2 s  EXPL -> HOLD")]
    asked = (72.0, "hold", "accepted: it stops and hovers")
    words = texts(asked, states=[*states, *HOVERS[1800:]], said=held, text=text)
    assert ("m, though a hold was accepted at" in words) == bool(found)
    assert found in words


def test_a_hold_where_it_holds_may_stop_a_climb():
    held = [(58.0, "58.0 s  EXPL -> HOLD")]
    asked = (70.0, "hold", "accepted: it stops and hovers")
    assert "hold was accepted, not done" not in texts(asked, states=HOVERS, said=held)
    assert "hold was accepted, not done" in texts(asked, states=HOVERS)


@pytest.mark.parametrize(("on", "wrong"), [((0, 60), False), ((60, 60), True), ((20, 50), False)])
def test_points_before_a_hold_are_not_flown_to_again(on, wrong):
    """Sent to two points, held on its way to the second: the first is not left."""
    tour = f"goto {degrees(60, 60)} {degrees(0, 60)}"
    asked = [
        (45.0, tour, "accepted: it flies to 2 points"),
        (50.0, "hold", "accepted: it stops and hovers"),
        (55.0, "resume", "accepted: it flies on to the points that are left"),
    ]
    sent = [goto(45.1, 60, 60), goto(48.0, 0, 60), goto(55.2, *on)]
    assert ("where it was before it was held" in texts(*asked, more=sent)) == wrong
    assert "where it was before it was held" not in texts(*asked, more=[sent[0], sent[2]])
