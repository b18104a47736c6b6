"""Whole nodes without sockets: who pulls when, and that nothing is ever lost or mixed up."""

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from benchmarks.fleet.network_sim import NAMES, NetworkSim, T
from mocha_link.clock import Instant
from mocha_link.links.metrics import (
    ContactBegan,
    ContactEnded,
    Direction,
    LinkState,
    MessageStored,
    RssiChanged,
    SyncEnded,
    SyncStarted,
    SyncTimedOut,
)
from mocha_link.links.reading import Reading, Unit
from mocha_link.sync.protocol import Connect, Disconnect, Send
from tests.mocha_link.fuzz import EXPLORE

WAYS = ("zmq", "udp", "both", "original", "mixed")


def make(team, way: str, **options: object) -> NetworkSim:
    """The network over which nodes talk in one way only, or in any."""
    if way in ("original", "mixed"):
        robots = NAMES if way == "original" else ("titan",)
        team = team.with_robots({name: {"original": True} for name in robots})
    net = NetworkSim(team, datagrams=way in ("udp", "both"), **options)
    if way == "udp":
        net.blocked = {("zmq", a, b) for a in NAMES for b in NAMES}
    return net


@pytest.fixture
def net(team) -> NetworkSim:
    return NetworkSim(team)


@pytest.fixture(params=WAYS)
def any_ether(team, request) -> NetworkSim:
    return make(team, request.param)


def test_a_data_mule_carries_between_robots_that_never_meet(any_ether):
    net = any_ether
    net.publish("callisto", "/pose", b"callisto is here")
    net.pull("titan", "callisto")
    net.pull("io", "titan")
    assert net.held("io") == {("callisto", "/pose"): b"callisto is here"}
    assert net.nodes["io"].links(net.now)["callisto"].syncs_in == 0
    stored = net.events_of("io", MessageStored)
    assert [(e.peer, e.robot, e.topic) for e in stored] == [("titan", "callisto", "/pose")]


def test_a_contact_triggers_at_once_then_every_interval(net):
    io = net.nodes["io"]
    io.signal_received("titan", -80, net.now)
    assert io.take() == ([], [RssiChanged("titan", T, -80, Reading(-80, Unit.DBM, "radio"))])
    io.signal_received("titan", -70, net.now)
    actions, events = io.take()
    assert [type(a) for a in actions] == [Connect, Send, Send]
    assert [a.frame[6:11] for a in actions[1:]] == [b"SYNC1", b"GHEAD"]
    assert [type(e) for e in events] == [RssiChanged, ContactBegan, SyncStarted]
    io.signal_received("titan", -70, net.now)
    assert io.take() == ([], [])
    assert io.links(net.now)["titan"].state is LinkState.STARTED


def test_one_pull_per_peer_at_a_time(net):
    io = net.nodes["io"]
    assert io.sync("titan", net.now)
    assert not io.sync("titan", net.now)
    assert io.sync("callisto", net.now)


def test_a_failed_pull_is_tried_again_at_the_next_trigger(net):
    io = net.nodes["io"]
    for second in range(9):
        net.time_s = float(second)
        io.signal_received("titan", -70, net.now)
        io.tick(net.now)
    actions, events = io.take()
    assert [type(a) for a in actions] == [Connect, Send, Send, Disconnect, Connect, Send, Send]
    assert [type(e) for e in events] == [
        RssiChanged,
        ContactBegan,
        SyncStarted,
        SyncTimedOut,
        SyncStarted,
    ]
    assert io.links(net.now)["titan"].timeouts == 1


@pytest.mark.parametrize(
    ("way", "path"), [("zmq", "zmq"), ("udp", "udp"), ("original", "original")]
)
def test_the_path_and_its_round_trip_are_reported(team, way, path):
    net = make(team, way, delay_s=0.05)
    net.publish("titan", "/map", b"map" * 1000)
    net.pull("io", "titan")
    link = net.nodes["io"].links(net.now)["titan"]
    assert link.path == path
    if way != "zmq":  # there the shell queries the kernel
        assert link.rtt_s == pytest.approx(0.1, abs=0.03)
    net.nodes["io"].sync("titan", net.now)
    net.nodes["io"].progress("titan", net.now, 0.123)
    net.settle()
    if way == "zmq":
        assert net.nodes["io"].links(net.now)["titan"].rtt_s == 0.123


def test_a_reboot_with_a_clock_that_is_behind_loses_nothing(any_ether):
    """The first life's message has the later stamp; the second life's must win all the same."""
    net = any_ether
    net.publish("callisto", "/path", b"first life")
    net.publish("callisto", "/pose", b"first life")
    net.pull("titan", "callisto")
    net.offset_s["callisto"] = -3600.0
    net.restart("callisto")
    net.publish("callisto", "/path", b"second life")
    net.pull("titan", "callisto")
    net.pull("callisto", "titan")
    assert net.held("callisto") == {
        ("callisto", "/path"): b"second life",
        ("callisto", "/pose"): b"first life",
    }
    net.pull("titan", "callisto")
    assert net.held("titan") == net.held("callisto")


STEPS = st.lists(
    st.one_of(
        st.tuples(st.just("publish"), st.sampled_from(("callisto", "io")), st.integers(0, 2)),
        st.tuples(st.just("pull"), st.permutations(NAMES), st.integers(0, 5)),
        st.tuples(st.just("wait"), st.integers(1, 20), st.just(0)),
    ),
    max_size=40,
)


@pytest.mark.parametrize("way", WAYS)
@settings(
    max_examples=1000 if EXPLORE else 8,
    suppress_health_check=[HealthCheck.function_scoped_fixture],  # the team never changes
)
@given(steps=STEPS)
def test_whatever_is_cut_everything_arrives_in_the_end(team, way, steps):
    net = make(team, way)
    newest = {}
    for number, (what, who, choice) in enumerate(steps):
        if what == "publish":
            topic = ("/pose", "/path", "/cloud")[choice]
            newest[who, topic] = f"{who}{topic} {number}".encode() * 50
            net.publish(who, topic, newest[who, topic])
        elif what == "pull":
            net.pull(who[0], who[1], cut_after=choice)
        else:
            net.wait(who)
    for _ in range(2):  # two good rounds through titan; callisto and io do not meet
        net.wait(10)  # pulls that were cut break off
        for client, server in (
            ("titan", "callisto"),
            ("titan", "io"),
            ("callisto", "titan"),
            ("io", "titan"),
        ):
            net.pull(client, server)
    assert all(net.held(name) == newest for name in NAMES)


def test_a_sync_whose_end_was_lost_is_ended_when_the_peer_requests_again(team):
    net = make(team, "udp", delay_s=0.05)
    net.publish("titan", "/map", b"a map")

    def end_is_lost(piece) -> bool:
        return piece.source == "titan" or net.held("io") == {} or net.time_s > 0.8

    net.lets_by = end_is_lost
    net.pull("io", "titan")
    net.wait(10.0)
    (ended,) = net.events_of("titan", SyncEnded)
    assert (ended.direction, ended.complete) == (Direction.OUT, True)
    assert net.events_of("titan", SyncTimedOut) == []


def test_pulls_that_fail_measure_no_round_trip(team):
    net = NetworkSim(team, by_timer=True, delay_s=0.05)
    io = net.nodes["io"]
    for rtt_s in (0.02, 0.4):
        net.pull("io", "titan")
        io.sync("titan", net.now)
        io.progress("titan", net.now, rtt_s)
        net.settle()
    before = io.links(net.now)["titan"]
    net.silent = {"titan"}
    net.wait(60)
    after = io.links(net.now)["titan"]
    assert after.timeouts > before.timeouts + 3
    assert (after.rtt_s, after.rtt_smoothed_s) == (before.rtt_s, before.rtt_smoothed_s)


def test_a_message_from_the_future_is_as_old_as_with_us(net):
    net.offset_s["titan"] = 3600.0
    net.publish("titan", "/map", b"grid")
    net.pull("io", "titan")
    net.time_s += 600
    age_s = net.nodes["io"].links(net.now)["titan"].newest_age_s
    assert age_s == pytest.approx(600, abs=1)


@pytest.mark.parametrize("step_s", [3600.0, -3600.0])
def test_a_machine_whose_clock_is_set_goes_on_as_if_it_was_not(net, step_s):
    """No contact ends or begins, none is pulled from but in its turn, and what is new is taken."""
    io = net.nodes["io"]

    def at(seconds: float) -> Instant:
        set_by_s = step_s if seconds >= 3 else 0.0
        return Instant(T + seconds + set_by_s, net.now.steady_s + seconds, may_step=True)

    def live(first: int, last: int) -> list[object]:
        events = []
        for quarter in range(4 * first, 4 * last):
            io.signal_received("titan", -60, at(quarter / 4))
            io.tick(at(quarter / 4))
            events += io.take()[1]
            assert io.due_in_s(at(quarter / 4)) <= 6
        return [event for event in events if isinstance(event, ContactBegan | ContactEnded)]

    assert [type(event) for event in live(0, 3)] == [ContactBegan]
    assert live(3, 6) == []
    io.tick(at(6 + 3 * net.team.trigger.interval_s))
    (ended,) = [event for event in io.take()[1] if isinstance(event, ContactEnded)]
    assert ended.at_s == T + 12 + step_s
    assert ended.duration_s == 12


@pytest.mark.parametrize("step_s", [3600.0, -3600.0])
def test_what_is_published_while_the_clock_is_set_replaces_what_was_there(any_ether, step_s):
    net = any_ether
    for number, offset_s in enumerate((0.0, step_s, 0.0)):
        net.offset_s = {"titan": offset_s}
        net.publish("titan", "/map", b"%d" % number)
        net.pull("io", "titan")
        net.pull("callisto", "io")
        assert net.held("callisto") == {("titan", "/map"): b"%d" % number}
        net.offset_s["callisto"] = step_s
        for age_s in net.nodes["callisto"].ages_s(net.at("callisto"))["titan"].values():
            assert age_s >= 0
        net.wait(1)


def test_what_comes_while_the_links_are_brought_up_to_date_counts_once(net, monkeypatch):
    io = net.nodes["io"]
    table = io._link_table
    catch_up, late = table.catch_up, [SyncTimedOut("titan", T, Direction.IN, "no answer")]

    def interrupted(events, now):
        catch_up(events, now)
        if late:
            io.announce(late.pop())

    monkeypatch.setattr(table, "catch_up", interrupted)
    io.announce(SyncTimedOut("titan", T, Direction.IN, "no connection"))
    assert [io.links(net.now)["titan"].timeouts for _ in range(3)] == [1, 2, 2]
