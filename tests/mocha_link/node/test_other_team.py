"""Two new nodes with team files that differ: what both define alike is exchanged, and no more."""

import logging

import pytest

from benchmarks.fleet.network_sim import NetworkSim, team_of
from mocha_link.links.link_table import REMIND_S
from mocha_link.links.metrics import Direction, SyncEnded, SyncTimedOut
from mocha_link.node.gossip import Gossip
from mocha_link.store.trust import config_hash_of
from mocha_link.sync import frames as sync
from mocha_link.sync.protocol import Send
from mocha_link.sync.sync_messages import Hello, Reception
from mocha_link.team.team import Team
from tests.mocha_link.old_node import OldNode

TEXT = """\
robots:
  a: {kind: rover, address: a, base_port: 10, clients: [b]}
  b: {kind: rover, address: b, base_port: 10, clients: [a]}
kinds:
  rover:
    topics:
      - {name: /pose, type: json/Pose}
      - {name: /path, type: json/Path, min_interval_s: 1}
"""
BETWEEN = "  a0: {kind: rover, address: c, base_port: 10, clients: []}\n  b:"
LAST = "  z: {kind: rover, address: c, base_port: 10, clients: []}\nkinds:"
FIRST_TOPIC = "topics:\n      - {name: /goal, type: json/Goal}"
OTHER_KIND = "kinds:\n  boat: {topics: [{name: /x, type: a/B}, {name: /y, type: z/Z}]}"
IN, OUT = Direction.IN, Direction.OUT
WHY = "has another team file; not exchanged: "


TEAM = team_of(TEXT)
SHIFTING = {
    "a robot in between": TEXT.replace("  b:", BETWEEN),
    "a robot behind all others": TEXT.replace("kinds:", LAST),
    "another name": TEXT.replace("  b:", "  c:").replace("[b]", "[c]"),
    "a topic before the others": TEXT.replace("topics:", FIRST_TOPIC),
    "a topic behind the others": TEXT + "      - {name: /x, type: json/Pose}\n",
    "topics in another order": TEXT.replace("/pose, type: json/Pose", "/p, type: json/Pose"),
    "another type": TEXT.replace("json/Pose", "json/Point"),
    "a type that moves the numbers of others": TEXT.replace("kinds:", OTHER_KIND),
    "batches": TEXT.replace("min_interval_s: 1", "min_interval_s: 1, aggregate: true"),
    "another ROS": TEXT.replace("b: {kind: rover", "b: {kind: rover, ros: 2"),
}
HARMLESS = {
    "addresses": TEXT.replace("address: b", "address: 10.1.2.3, listen: 10.1.2.3"),
    "ports": TEXT.replace("base_port: 10", "base_port: 4000"),
    "radios": TEXT.replace("address: b", "address: b, radio: 'udp://h:9', radio_id: x"),
    "a key": TEXT.replace("address: b", f"address: b, key: '{'0' * 40}'"),
    "an original node": TEXT.replace("address: b", "address: b, original: true"),
    "rates": TEXT.replace("min_interval_s: 1", "min_interval_s: 2"),
    "urgency": TEXT.replace("json/Pose", "json/Pose, priority: high"),
    "history": TEXT.replace("json/Pose", "json/Pose, history: 9"),
    "the name of a kind": TEXT.replace("rover", "car"),
    "triggers": TEXT + "trigger: {interval_s: 9, rssi_threshold_dbm: -60}\n",
    "trust": TEXT + "trust: signed\n",
    "comments and order": "# robots\n"
    + "".join([TEXT.splitlines(True)[i] for i in (0, 2, 1, 3, 4, 5, 6, 7)]),
}


@pytest.mark.parametrize("text", SHIFTING.values(), ids=SHIFTING)
def test_what_moves_ids_or_types_counts(text):
    assert config_hash_of(team_of(text)) != config_hash_of(TEAM)


@pytest.mark.parametrize("text", HARMLESS.values(), ids=HARMLESS)
def test_what_does_not_is_free(text):
    assert config_hash_of(team_of(text)) == config_hash_of(TEAM)


class Field(NetworkSim):
    """a has TEAM, b another team file."""

    def __init__(self, other: Team, **options: object) -> None:
        super().__init__(TEAM, names=("a", "b"), **options)
        self.change("b", other)

    def change(self, name: str, team: Team) -> None:
        own, self.team = self.team, team
        self.restart(name)
        self.team = own


@pytest.fixture(params=["a robot in between", "a topic before the others"])
def other(request) -> Team:
    return team_of(SHIFTING[request.param])


@pytest.fixture(params=[False, True], ids=["tcp", "udp"])
def field(other, request) -> Field:
    field = Field(other, datagrams=request.param, delay_s=0.05)
    field.publish("a", "/pose", b"here is a")
    field.nodes["b"].publish(other.topic("b", "/pose"), b"here is b", field.now)
    return field


def own(field: Field) -> dict[str, list[bytes]]:
    """What each of the two may hold: a is the first robot of all teams, b another one in each."""
    bodies = {
        name: [each.body for each in node.database.kept()] for name, node in field.nodes.items()
    }
    return {"a": bodies["a"][:1], "b": bodies["a"][:1] + bodies["b"]}


def differs(field: Field, name: str) -> bool:
    return next(iter(field.nodes[name].links(field.now).values())).team_differs


def exchange(field: Field) -> None:
    field.pull("a", "b")
    field.pull("b", "a")


def test_what_both_define_otherwise_is_not_exchanged_and_both_log_it(field, caplog):
    exchange(field)
    for name, peer in (("a", "b"), ("b", "a")):
        node = field.nodes[name]
        assert not [each for each in node.database.kept() if each.body not in own(field)[name]]
        assert not field.events_of(name, SyncTimedOut)
        assert all(each.complete for each in field.events_of(name, SyncEnded))
        assert differs(field, name)
        assert f"{name}: {peer} {WHY}" in caplog.text
    # Neither requested anything of the other by ids.
    requested = field.sent("zmq", "a", "b") + field.sent("zmq", "b", "a")
    assert not [frame for frame in requested if frame[6:11] in (b"GDATA", b"DENDT")]


@pytest.mark.parametrize("datagrams", [False, True])
def test_a_topic_more_on_one_side_stops_nothing_else(datagrams, caplog):
    """A roll-out goes from robot to robot."""
    other = team_of(SHIFTING["a topic behind the others"])
    field = Field(other, datagrams=datagrams, delay_s=0.05)
    b = field.nodes["b"]
    field.publish("a", "/pose", b"here is a")
    for topic in ("/pose", "/x"):
        b.publish(other.topic("b", topic), b"here is b", field.now)
    exchange(field)
    both = {("a", "/pose"): b"here is a", ("b", "/pose"): b"here is b"}
    assert field.held("a") == both
    assert not field.events_of("a", SyncTimedOut) + field.events_of("b", SyncTimedOut)
    assert differs(field, "a")
    assert differs(field, "b")
    assert "a: b has another team file; not exchanged: 2 topics as b has them" in caplog.text
    assert "b: a has another team file; not exchanged: /x of a; /x of b" in caplog.text
    assert not field.nodes["a"].links(field.now)["b"].refused
    b.publish(other.topic("b", "/pose"), b"there is b", field.now)
    b.tick(field.now)
    field.wait(1)
    assert field.held("a")["b", "/pose"] == b"there is b"
    field.change("a", other)  # the roll-out is through: what was left out comes
    exchange(field)
    field.team = other
    assert field.held("a")["b", "/x"] == b"here is b"
    assert not differs(field, "a")


def test_two_processes_of_a_robot_are_known_by_their_boot_ids(caplog):
    field = Field(TEAM)
    twins = [field.nodes["b"]]
    field.restart("b")
    twins.append(field.nodes["b"])
    field.pull("b", "a")
    assert not field.nodes["a"].links(field.now)["b"].duplicate
    for twin in (*twins, *twins):
        field.become("b", twin)
        field.pull("b", "a")
    assert field.nodes["a"].links(field.now)["b"].duplicate
    assert any(twin.links(field.now)["a"].duplicate for twin in twins)
    logged = [r.message for r in caplog.records if "two processes run as b" in r.message]
    assert {line.partition(":")[0] for line in logged} == {"a", "b"}
    assert len([line for line in logged if line.startswith("a:")]) == 1
    for _ in range(20):  # one of them was ended
        field.pull("b", "a")
    assert not field.nodes["a"].links(field.now)["b"].duplicate
    assert not field.nodes["b"].links(field.now)["a"].duplicate


def test_a_trial_beside_the_node_is_no_second_process():
    """As `mocha-link doctor` makes one."""
    field = Field(TEAM)
    own = field.nodes["b"]
    trial = Gossip(TEAM, "b", by_timer=True, trial=True)
    for each in (own, trial, own, trial, own):
        field.become("b", each)
        field.pull("b", "a")
    assert not field.nodes["a"].links(field.now)["b"].duplicate


def test_restarts_are_no_duplicates():
    field = Field(TEAM)
    for _ in range(20):
        field.restart("b")
        field.pull("b", "a")
    assert not field.nodes["a"].links(field.now)["b"].duplicate


def test_with_the_same_file_all_goes_on(field):
    exchange(field)
    field.change("b", TEAM)
    field.publish("b", "/pose", b"here is b")
    exchange(field)
    same = {("a", "/pose"): b"here is a", ("b", "/pose"): b"here is b"}
    assert field.held("a") == field.held("b") == same
    assert not differs(field, "a")
    assert not differs(field, "b")


def test_it_is_logged_once_in_a_while(field, caplog):
    caplog.set_level(logging.DEBUG, "mocha_link")

    def warnings() -> int:
        return sum(r.levelno == logging.WARNING and WHY in r.message for r in caplog.records)

    for _ in range(20):
        exchange(field)
        field.wait(2)
    assert warnings() == 2  # each its own
    field.wait(REMIND_S)
    exchange(field)
    assert warnings() == 4


def test_a_damaged_opening_does_not_make_it_an_original_node(other):
    """The fallback to the old protocol would read by ids."""
    field = Field(other)
    field.nodes["b"].publish(other.topic("b", "/pose"), b"here is b", field.now)
    field.alter = lambda piece: (
        piece.data[:40] + bytes((piece.data[40] ^ 1,)) + piece.data[41:]
        if piece.data[6:11] == b"SYNC1"
        else piece.data
    )
    for _ in range(3):
        field.pull("a", "b")
    assert not field.nodes["a"].database.kept()
    (reason,) = {e.reason for e in field.events_of("a", SyncTimedOut)}
    assert reason == "b could not decode our OPEN; it was damaged"


def test_a_foreign_node_is_not_taken_for_an_original_one_at_the_first_error(other):
    """It is one only if it answers like one twice: then another machine has taken its place."""
    field = Field(other)
    field.pull("a", "b")
    OldNode(field, "b").publish("/pose", b"here is b")
    field.pull("a", "b")
    assert not field.held("a")
    broken = field.events_of("a", SyncTimedOut)[-1]
    assert broken.reason == "b had another team file; requesting once more"
    field.pull("a", "b")
    assert field.held("a") == {("b", "/pose"): b"here is b"}


def answers(field: Field, *frames: bytes) -> None:
    """a's opening gets these answers."""
    node = field.nodes["a"]
    node.sync("b", field.now)
    actions, _ = node.take()
    first = next(each.frame for each in actions if isinstance(each, Send))
    for frame in frames:
        node.reply("b", [first[:6] + frame], field.now)


def hello(*fields: object) -> bytes:
    return sync.message_frame(sync.HELLO, 0, Hello(*fields).encode(), 0, 1000)


@pytest.mark.parametrize("reception", [Reception.WELCOME, Reception.TOPICS_WANTED])
def test_who_sends_another_config_hash_hands_us_nothing(reception, caplog):
    """Not even if it goes on as if they were ours."""
    field = Field(TEAM)
    publisher = NetworkSim(TEAM, names=("a", "b"))
    publisher.publish("b", "/pose", b"here is b")
    (record,) = publisher.nodes["b"].database.kept()
    whole = sync.WHOLE.pack(sync.message_id_of(1, 0, record.stamp_ms), len(record.body))
    chunks = b"".join(sync.chunks_parts((0, 0), [whole], [], [record.body]))
    answers(field, hello(reception, 12345), chunks)
    assert not field.nodes["a"].database.kept()
    assert "/pose of b is not exchanged with b; use the same team file everywhere" in caplog.text
