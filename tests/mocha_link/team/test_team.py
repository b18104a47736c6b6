"""The team file: ids and ports as the original derives them, and clear errors."""

from pathlib import Path

import pytest
import yaml

from mocha_link.team.document import Document, DocumentError
from mocha_link.team.team import Priority, Team, Trust, UnknownRobotError
from tests.mocha_link.conftest import DATA

PATH = Path("team.yaml")
TEXT = (DATA / "fleet.yaml").read_text()


def team(text: str = TEXT) -> Team:
    return Team.from_document(Document.from_text(text, PATH))


def problems(text: str) -> list[str]:
    with pytest.raises(DocumentError) as caught:
        team(text)
    found = caught.value.problems
    assert str(caught.value) == "\n".join(map(str, found))
    return [str(problem).removesuffix(f" [{problem.code}]") for problem in found]


def test_ids_are_the_original_ones():
    # The ids of the captured exchange: callisto 1 (of basestation, callisto, io, titan) there.
    assert {name: robot.robot_id for name, robot in team().robots.items()} == {
        "titan": 2,
        "callisto": 0,
        "io": 1,
    }
    dtypes = {topic.name: topic.dtype for topic in team().topics_of("callisto")}
    # PoseArray 0, PoseStamped 1, PoseWithCovarianceStamped 2, Path 3 and 4, PointCloud2 5
    assert dtypes == {"/pose": 2, "/map": 5, "/path": 3}
    assert [topic.topic_id for topic in team().topics_of("io")] == [0, 1, 2]
    assert team().topic("titan", "/path").priority is Priority.LOW
    assert team().topic("titan", "/path").min_interval_s == 5
    assert team().topic("titan", "/key_pose").priority is Priority.NONE


def test_ports_are_indices_in_the_own_client_list():
    titan, io = team().robot("titan"), team().robot("io")
    assert titan.port_for("callisto") == 26234
    assert titan.port_for("io") == 26235
    assert io.port_for("titan") == 24236  # its own name keeps index 0
    assert io.peers == ("callisto", "titan")
    with pytest.raises(UnknownRobotError, match="among the clients of io; use one of callisto"):
        io.port_for("io")


def test_an_empty_place_among_the_clients_keeps_its_port_unused():
    text = TEXT.replace("clients: [io, titan]", "clients: [null, io, null, titan]")
    callisto = team(text).robot("callisto")
    assert callisto.peers == ("io", "titan")
    assert callisto.port_for("titan") == 23237
    assert Team.from_document(Document.from_text(team(text).dump(), PATH)) == team(text)


def test_what_keys_topics_and_definitions_may_contain():
    key = "rq:rM>}U?@Lns47E1%kR.o@n%FcmmsL/@{H8]yf7"
    text = TEXT.replace("base_port: 23234", f"base_port: 23234\n    key: '{key}'\n    ros: 2")
    text += "trust: signed\ndefinitions: {my_msgs/Goal: 'float64 x'}\n"
    assert team(text).robot("callisto").key == key
    assert team(text).robot("callisto").ros == 2
    assert team(text).trust is Trust.SIGNED
    assert team(text).definitions == {"my_msgs/Goal": "float64 x"}
    assert "40 characters" in problems(text.replace(key, key[:-1]))[0]
    assert "knows no keys" in problems(text.replace("ros: 2", "original: true"))[0]
    text = TEXT.replace("min_interval_s: 5", "aggregate: true")
    assert "aggregate needs min_interval_s" in problems(text)[0]
    text = TEXT.replace("min_interval_s: 5", "min_interval_s: 5, aggregate: true")
    assert team(text).topic("titan", "/path").aggregate
    text = text.replace("clients: [io, titan]", "clients: [io, titan]\n    original: true")
    assert "the original node of callisto ends over messages that go together" in problems(text)[0]


def test_names_that_do_not_fit_together():
    text = TEXT.replace("clients: [callisto, io]", "clients: [calisto, io, io]")
    text = text.replace("kind: ground_robot", "kind: groundrobot", 1)
    text = text.replace("name: /map", "name: /pose")
    assert problems(text) == [
        "team.yaml:7:15: no robot 'calisto' under robots; use one of callisto, io, titan",
        "team.yaml:7:28: 'io' is listed twice; remove one",
        (
            "team.yaml:10:11: no kind 'groundrobot' under kinds; "
            "use one of ground_robot, aerial_robot, base_station, or add it"
        ),
        ("team.yaml:13:19: 'titan' does not list 'callisto'; add it to the clients of titan"),
        "team.yaml:23:16: topic '/pose' is listed twice; remove one",
    ]


def test_ports_that_clash():
    text = TEXT.replace("base_port: 24234", "base_port: 23235").replace("26234", "65535")
    assert problems(text) == [
        "team.yaml:6:16: the last port would be 65536; use a lower base_port",
        (
            "team.yaml:17:16: ports 23235 to 23237 overlap those of callisto at the same "
            "address (23234 to 23235); use 23236 or more"
        ),
    ]
    alone = "  x: {kind: base_station, address: 127.0.1.4, base_port: 26235, clients: []}\n"
    assert team(TEXT.replace("robots:\n", f"robots:\n{alone}")).robot("x")  # it has no ports


@pytest.mark.parametrize(
    ("old", "new", "problem"), yaml.safe_load((DATA.parent / "refused" / "team.yaml").read_text())
)
def test_wrong_values_name_their_place(old, new, problem):
    found = problems(TEXT.replace(old, new, 1))
    assert any(line.startswith(problem) for line in found), found


@pytest.mark.parametrize("wrong", ["a b", "a/b", "x" * 70])
def test_an_invalid_name_is_explained(wrong):
    with pytest.raises(DocumentError) as error:
        Team.from_document(Document.from_text(TEXT.replace("titan", f"'{wrong}'"), PATH))
    explained = f"'{wrong:.40}' is no name: use 1 to 64 characters without spaces, / and :"
    assert all(explained in str(problem) for problem in error.value.problems)
