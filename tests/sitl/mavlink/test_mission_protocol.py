"""The mission microservice beyond the conversations: two links, and the wall's clock."""

from sitl.conformance.conversation import run_steps
from sitl.conformance.session import Link, Session
from tests.sitl.prepared import local_line, ready_for

ERROR = 1


def test_two_links_cannot_upload_at_once():
    session = ready_for(links=frozenset(Link))
    session.say("MISSION_COUNT", count=2)
    session.say("MISSION_COUNT", Link.GROUND, count=2)
    assert session.run(1.0, lambda: bool(session.since("MISSION_ACK", Link.GROUND)))
    assert session.newest("MISSION_ACK", Link.GROUND)["type"] == ERROR


def test_time_outs_are_on_the_wall_clock_when_the_simulation_is_fast():
    session = Session(local_line(speed=10.0))
    session.run(5)
    asked = {"count": "MISSION_REQUEST_INT", "fields": {"seq": 0}}
    upload = {"send": "MISSION_COUNT", "fields": {"count": 3}}
    run_steps(session, [upload, asked | {"for_s": 20, "between": (8, 9)}])  # two wall seconds
