"""A fleet that is not as in its team file: a roll-out under way, a robot that runs twice."""

import contextlib
import logging

from benchmarks.fleet.network_sim import team_of
from mocha_link.links.metrics import MessageStored
from mocha_link.node.node import Node
from mocha_link.radios import ManualRadio
from tests.mocha_link.conftest import TEAM, Witness, field, free_ports  # noqa: F401 - a fixture


def test_a_roll_out_from_robot_to_robot_stops_nothing_that_both_know(field, caplog):  # noqa: F811
    """titan has the new file: a topic more behind the others."""
    caplog.set_level(logging.WARNING, "mocha_link")
    text = TEAM.replace(
        "min_interval_s: 5}", "min_interval_s: 5}\n      - {name: /new, type: json/Pose}"
    )
    robots = field.team.robots
    places = {
        name: {key: getattr(robot, key) for key in ("base_port", "address", "listen")}
        for name, robot in robots.items()
    }
    new = team_of(text).with_robots(places)
    with Node(field.team, "io") as io, Node(new, "titan") as titan:
        here, there = Witness(io), Witness(titan)
        titan.publish("/new", b"nobody knows this")
        titan.publish("/map", b"grid")
        io.publish("/pose", b"here")
        here.wait(MessageStored, peer="titan", topic="/map")
        there.wait(MessageStored, peer="io", topic="/pose")
        assert io.links()["titan"].team_differs
        assert titan.links()["io"].team_differs
        assert io.links()["titan"].refused == 0
    assert "titan: io has another team file; not exchanged: /new of titan" in caplog.text


def test_a_robot_that_runs_twice_is_seen_on_both_sides(field):  # noqa: F811
    """The second one has its ports elsewhere, so that it can start."""
    base = free_ports(field.host, len(field.team.robot("io").clients))
    elsewhere = field.team.with_robots({"io": {"base_port": base}})
    with contextlib.ExitStack() as stack:
        titan = stack.enter_context(Node(field.team, "titan", radio=ManualRadio()))
        twins = [
            stack.enter_context(Node(team, "io", radio=ManualRadio()))
            for team in (field.team, elsewhere)
        ]
        witnesses = [Witness(twin) for twin in twins]
        for witness in (*witnesses, *witnesses):
            witness.pull("titan")
        assert titan.links()["io"].duplicate
        assert any(twin.links()["titan"].duplicate for twin in twins)
