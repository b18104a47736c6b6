"""What an accepted request obliges to: the text of the answer excuses nothing."""

import pytest

from sitl.rehearsal.judge.evidence import SceneEvent, SceneEventKind
from sitl.rehearsal.judge.verdict import judge
from tests.sitl.rehearsal.judge.test_judge import FRAME, TEXT, command, goto
from tests.sitl.rehearsal.judge.test_judge_inputs import FLOWN, HOVERS, flight


def texts(*answers, states=FLOWN, more=(), announced=(), happenings=(), text=TEXT):
    """Of a flight with these requests: when, what, and the answer."""
    requested = tuple(SceneEvent(at_s, SceneEventKind.REQUEST, verb) for at_s, verb, _ in answers)
    lines = [(43.0, "43.0 s  READY -> INIT"), (44.0, "44.0 s  INIT -> EXPL")]
    lines += [(at_s + 0.1, f"{at_s} s  the operator: {answer}") for at_s, _, answer in answers]
    lines += announced
    happenings = requested + tuple(happenings)
    flown = flight(states, announced=sorted(lines), more=more, happenings=happenings, text=text)
    return " | ".join(str(v) for v in judge(flown).violations if v.kind in {"request", "report"})


@pytest.mark.parametrize("answer", ["accepted: it stops and hovers", "accepted: it holds already"])
def test_a_hold_is_held_whatever_it_is_called(answer):
    assert "hold was accepted" in texts((60.0, "hold", answer))
    held = [(70.0, "70.0 s  EXPL -> HOLD")]
    assert "hold was accepted" not in texts((70.0, "hold", answer), states=HOVERS, announced=held)


@pytest.mark.parametrize(
    ("verb", "answer"),
    [
        ("seek io", "accepted: it seeks io"),
        ("home", "accepted: it comes home; it sets out once the changed zones are on board"),
        ("home", "accepted: it comes home already"),
        ("explore", "accepted: it explores already"),
    ],
)
def test_after_every_way_that_is_accepted_something_is_sent(verb, answer):
    still = [*FLOWN[:1200], *[FLOWN[1200]] * 2000, *FLOWN[1200:]]
    announced = [(72.0, "72.0 s  EXPL -> GOTO")]
    assert f"though {verb.split()[0]} was accepted" in texts(
        (74.0, verb, answer), states=still, announced=announced
    )
    sent = [goto(75.0, 0, 60)]
    assert f"though {verb.split()[0]} was accepted" not in texts(
        (74.0, verb, answer), states=still, more=sent, announced=announced
    )


def degrees(east, north):
    return ",".join(f"{angle:.7f}" for angle in FRAME.degrees(east, north))


@pytest.mark.parametrize(
    ("place", "wrong"),
    [((0, 60), False), ((-60, 20), True), ((30, 30), False), ((9, 60), False)],
)
def test_a_point_that_is_accepted_is_come_to(place, wrong):
    requested = (55.0, f"goto {degrees(*place)}", "accepted: it flies to the point")
    found = texts(requested, more=[goto(55.5, 0, 60)])
    assert ("to a point that was accepted" in found) == wrong


def test_points_in_a_zone_are_come_as_near_to_as_that_allows():
    requested = (55.0, f"goto {degrees(30, 39)}", "accepted: it flies to the point: beside it")
    over = TEXT.replace("[40, 40], [20, 40]", "[40, 59], [20, 59]")
    assert over != TEXT
    assert "to a point that was accepted" in texts(requested, more=[goto(55.5, 0, 60)])


@pytest.mark.parametrize(
    "answer", ["accepted: it lands where it hovers", "accepted: it lands already"]
)
def test_a_landing_is_commanded(answer):
    held = [(58.0, "58.0 s  EXPL -> HOLD")]
    wanted = "no landing was commanded"
    assert wanted in texts((75.0, "land", answer), states=HOVERS, announced=held)
    commanded = [command(75.5, 21)]
    assert wanted not in texts(
        (75.0, "land", answer), states=HOVERS, announced=held, more=commanded
    )


def test_a_hold_that_is_resumed_ends():
    held = [(58.0, "58.0 s  EXPL -> HOLD")]
    requested = (75.0, "resume", "accepted: it resumes")
    assert "it holds on" in texts(requested, states=HOVERS, announced=held)
    on = [*held, (75.2, "75.2 s  HOLD -> EXPL")]
    assert "it holds on" not in texts(requested, states=HOVERS, announced=on)


def test_points_that_wait_are_not_forgotten():
    requested = [
        (60.0, "goto 39.9,-75.2", "points from the operator wait until the vehicle flies on")
    ]
    long = [*FLOWN[:1400], *[FLOWN[1400]] * 3000, *FLOWN[1400:]]
    assert "forgotten" in texts(*requested, states=long)
    later = [(90.0, "90.0 s  the operator: accepted: it flies to the point")]
    assert "forgotten" not in texts(*requested, states=long, announced=later)


@pytest.mark.parametrize(
    ("drawn", "wrong"), [("", True), ("{centre: [60, 100], radius_m: 9}", True), ("near", False)]
)
def test_only_what_is_new_and_near_is_left(drawn, wrong):
    at_s = 60.0  # at (0, 45), on its way home
    near = "{centre: [0, 35], radius_m: 9}"
    zone = f"  - {{circle: {near if drawn == 'near' else drawn}}}\n" if drawn else ""
    new = (SceneEvent(at_s - 1.0, SceneEventKind.MISSION_FILE, TEXT + zone),) if drawn else ()
    found = texts(announced=[(at_s, "60.0 s  leaving no-fly zone 'x'")], happenings=new)
    assert ("nothing new is near" in found) == wrong


def test_a_vehicle_that_announces_its_way_home_lands():
    long = [*FLOWN[:1400], *[FLOWN[1400]] * 3000, *FLOWN[1400:]]
    announced = [(65.0, "65.0 s  coming home: battery at 25%")]
    flown = flight(long, announced=announced)
    assert "it announced that it comes home" in str(judge(flown).violations)


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
    requested = (72.0, "hold", "accepted: it stops and hovers")
    violations = texts(requested, states=[*states, *HOVERS[1800:]], announced=held, text=text)
    assert ("m, though a hold was accepted at" in violations) == bool(found)
    assert found in violations


def test_a_hold_where_it_holds_may_stop_a_climb():
    held = [(58.0, "58.0 s  EXPL -> HOLD")]
    requested = (70.0, "hold", "accepted: it stops and hovers")
    assert "hold was accepted, not done" not in texts(requested, states=HOVERS, announced=held)
    assert "hold was accepted, not done" in texts(requested, states=HOVERS)


@pytest.mark.parametrize(("on", "wrong"), [((0, 60), False), ((60, 60), True), ((20, 50), False)])
def test_points_before_a_hold_are_not_flown_to_again(on, wrong):
    """Sent to two points, held on its way to the second: the first is not left."""
    tour = f"goto {degrees(60, 60)} {degrees(0, 60)}"
    requested = [
        (45.0, tour, "accepted: it flies to 2 points"),
        (50.0, "hold", "accepted: it stops and hovers"),
        (55.0, "resume", "accepted: it flies on to the remaining points"),
    ]
    sent = [goto(45.1, 60, 60), goto(48.0, 0, 60), goto(55.2, *on)]
    assert ("where it was before it was held" in texts(*requested, more=sent)) == wrong
    assert "where it was before it was held" not in texts(*requested, more=[sent[0], sent[2]])


# Its limits: each pair lies less than a factor of three from one.

STILL = [*FLOWN[:1200], *[FLOWN[1200]] * 3000, *FLOWN[1200:]]
"""Stands at (0, 45) from 60 s to 210 s."""

HELD = [(58.0, "58.0 s  EXPL -> HOLD")]


@pytest.mark.parametrize(
    ("leg_s", "wrong"), [(71.8, False), (73.0, True), (81.0, True), (83.0, False)]
)
def test_a_hold_is_sent_within_two_seconds_and_looked_at_for_twelve(leg_s, wrong):
    requested = (70.0, "hold", "accepted: it stops and hovers")
    found = texts(requested, states=HOVERS, more=[goto(leg_s, 60, 0)])
    assert ("a leg, though hold was accepted" in found) == wrong


@pytest.mark.parametrize(("lasts_s", "wrong"), [(4.5, False), (6.0, False), (7.4, True)])
def test_a_climb_that_a_hold_stops_ends_within_five_seconds_and_two_metres(lasts_s, wrong):
    states = [
        (east, north, height + 2.0 * min(max(n * 0.05 - 72.0, 0.0), lasts_s), *rest)
        for n, (east, north, height, *rest) in enumerate(HOVERS[:1800])
    ]
    held = [(72.2, "72.2 s  EXPL -> HOLD")]
    requested = (72.0, "hold", "accepted: it stops and hovers")
    text = f"{TEXT}altitudes_m: [25, 60]\n"
    found = texts(requested, states=[*states, *HOVERS[1800:]], announced=held, text=text)
    assert ("it climbs by" in found) == wrong


@pytest.mark.parametrize(("off_m", "wrong"), [(0.6, True), (2.0, False)])
def test_two_points_within_a_metre_are_the_same(off_m, wrong):
    requested = [
        (45.0, f"goto {degrees(60, 60)} {degrees(0, 60)}", "accepted: it flies to 2 points"),
        (50.0, "hold", "accepted: it stops and hovers"),
        (55.0, "resume", "accepted: it flies on to the remaining points"),
    ]
    sent = [goto(45.1, 60, 60), goto(48.0, 0, 60), goto(55.2, 60 - off_m, 60)]
    assert ("where it was before it was held" in texts(*requested, more=sent)) == wrong


@pytest.mark.parametrize(
    ("verb", "later_s", "wrong"),
    [("home", 6.5, False), ("home", 9.0, True), ("explore", 40.0, False), ("explore", 70.0, True)],
)
def test_a_way_is_begun_within_seven_seconds_or_where_it_explores_fifty_two(verb, later_s, wrong):
    requested = (74.0, verb, "accepted: it does")
    found = texts(requested, states=STILL, more=[goto(74.0 + later_s, 0, 60)])
    assert (f"though {verb} was accepted" in found) == wrong


@pytest.mark.parametrize(
    ("requested_s", "sent_s", "wrong"), [(74.0, 130.0, False), (140.0, 190.0, True)]
)
def test_what_waits_for_a_fence_may_wait_for_sixty_five_seconds(requested_s, sent_s, wrong):
    """It was changed at 60 s."""
    zone = "  - {name: new, polygon: [[300, 55], [303, 55], [303, 80], [300, 80]]}\n"
    changed = (SceneEvent(60.0, SceneEventKind.MISSION_FILE, TEXT + zone),)
    requested = (requested_s, "home", "accepted: it comes home")
    found = texts(requested, states=STILL, more=[goto(sent_s, 0, 60)], happenings=changed)
    assert ("though home was accepted" in found) == wrong


@pytest.mark.parametrize(("later_s", "wrong"), [(3.5, False), (6.0, True)])
def test_what_is_resumed_goes_on_within_four_seconds(later_s, wrong):
    on = [*HELD, (75.0 + later_s, f"{75.0 + later_s} s  HOLD -> EXPL")]
    requested = (75.0, "resume", "accepted: it resumes")
    assert ("it holds on" in texts(requested, states=HOVERS, announced=on)) == wrong


@pytest.mark.parametrize(("later_s", "wrong"), [(4.5, False), (8.0, True)])
def test_a_landing_is_commanded_within_five_seconds(later_s, wrong):
    requested = (75.0, "land", "accepted: it lands where it hovers")
    commanded = [command(75.0 + later_s, 21)]
    found = texts(requested, states=HOVERS, announced=HELD, more=commanded)
    assert ("no landing was commanded" in found) == wrong


@pytest.mark.parametrize(("later_s", "wrong"), [(90.0, False), (120.0, True)])
def test_points_wait_for_a_hundred_seconds(later_s, wrong):
    requested = (
        70.0,
        "goto 39.9,-75.2",
        "points from the operator wait until the vehicle flies on",
    )
    later = [(70.0 + later_s, "the operator: accepted: it flies to the point")]
    assert ("forgotten" in texts(requested, states=STILL, announced=later)) == wrong


def creeping(speed_m_s):
    """Westwards from (0, 45), from 60 s on."""
    east, north, *rest = FLOWN[1200]
    return [*FLOWN[:1200], *((east - n * speed_m_s / 20, north, *rest) for n in range(1000))]


@pytest.mark.parametrize(("speed_m_s", "wrong"), [(1.2, False), (0.4, True)])
def test_a_vehicle_that_moves_may_be_on_its_way_home(speed_m_s, wrong):
    requested = (70.0, "home", "accepted: it comes home already")
    assert ("though home was accepted" in texts(requested, states=creeping(speed_m_s))) == wrong


def standing(*place):
    """Stands there from 60 s on."""
    return [*FLOWN[:1200], *[(*place, *FLOWN[1200][2:])] * 1000]


@pytest.mark.parametrize(("away_m", "wrong"), [(4.0, False), (8.0, True)])
def test_a_vehicle_within_five_metres_of_home_is_there(away_m, wrong):
    requested = (70.0, "home", "accepted: it comes home already")
    assert ("though home was accepted" in texts(requested, states=standing(0, away_m))) == wrong


@pytest.mark.parametrize(("place", "wrong"), [((100, 100), False), ((180, 180), True)])
def test_who_seeks_may_stand_near_the_waypoints(place, wrong):
    requested = (70.0, "seek io", "accepted: it seeks io")
    seeks = [(70.2, "70.2 s  EXPL -> SEARCH")]
    found = texts(requested, states=standing(*place), announced=seeks)
    assert ("though seek was accepted" in found) == wrong


@pytest.mark.parametrize(
    ("later_s", "beside_m", "wrong"),
    [(35.0, 0.0, False), (50.0, 0.0, True), (35.0, 5.5, False), (35.0, 10.0, True)],
)
def test_a_point_is_come_to_in_the_time_that_the_way_takes(later_s, beside_m, wrong):
    """It is 40 m away: 41 s, and to 7 m."""
    requested = (70.0, f"goto {degrees(-40, 45)}", "accepted: it flies to the point")
    east, north, *rest = FLOWN[1200]
    first = 1400 + round(later_s / 0.05)
    states = [*FLOWN[:1200], *[FLOWN[1200]] * (first - 1200)]
    states += [(east - 40.0 + beside_m, north, *rest)] * 1000
    found = texts(requested, states=states, more=[goto(70.5, -40, 45)])
    assert ("to a point that was accepted" in found) == wrong


@pytest.mark.parametrize(("later_s", "wrong"), [(0.3, False), (1.0, True)])
def test_a_changed_file_may_count_half_a_second_before_the_event_of_the_scene(later_s, wrong):
    zone = "  - {circle: {centre: [0, 35], radius_m: 9}}\n"
    new = (SceneEvent(60.0 + later_s, SceneEventKind.MISSION_FILE, TEXT + zone),)
    found = texts(announced=[(60.0, "60.0 s  leaving no-fly zone 'x'")], happenings=new)
    assert ("nothing new is near" in found) == wrong
