"""The original nodes' YAML files become a team with the same ids and ports, or are refused."""

import shutil

import pytest
import yaml

from benchmarks.fleet.network_sim import team_of
from mocha_link.cli.cli import main
from mocha_link.team import upstream
from mocha_link.team.document import DocumentError
from mocha_link.team.team import Team
from tests.mocha_link.conftest import DATA

NAMES = ("robots", "topics", "radios")
TEXTS = {name: (DATA / "odd" / f"{name}.yaml").read_text() for name in NAMES}
REFUSED = yaml.safe_load((DATA.parent / "refused" / "upstream.yaml").read_text())


@pytest.fixture
def files(tmp_path):
    """Writes the three files, changed as the test wants, and reads them."""

    def read(changes=(), **options):
        texts = dict(TEXTS)
        for name, old, new in changes:
            assert old in texts[name]
            texts[name] = texts[name].replace(old, new, 1)
        paths = []
        for name, text in texts.items():
            paths.append(tmp_path / f"{name}.yaml")
            paths[-1].write_text(text)
        return upstream.load(*paths, **options)

    return read


def test_the_recorded_configuration():
    """The ids and ports that were seen on the wire."""
    folder = DATA / "upstream"
    result = upstream.load(folder / "robot_configs.yaml", folder / "topic_configs.yaml")
    ours = Team.load(DATA / "team.yaml")
    assert result.notices == ()
    assert result.team.kinds == ours.kinds
    for name, robot in result.team.robots.items():
        assert robot.original
        assert robot.robot_id == ours.robot(name).robot_id
        assert {peer: robot.port_for(peer) for peer in robot.peers} == {
            peer: ours.robot(name).port_for(peer) for peer in ours.robot(name).peers
        }


def test_every_oddity(files):
    result = files(ours=["base"], ros=2)
    team = result.team
    assert [robot.robot_id for robot in map(team.robot, ("base", "drone", "rover"))] == [0, 1, 2]
    base, drone, rover = (team.robot(name) for name in ("base", "drone", "rover"))
    assert base.clients == ("rover", "base", None, "drone")
    assert {peer: base.port_for(peer) for peer in base.peers} == {"rover": 1234, "drone": 1237}
    assert drone.clients == (None, None, "base")
    assert drone.port_for("base") == 4236
    assert rover.base_port == 5234
    assert base.radio_id == "00:00:00:00:00:01,00:00:00:00:00:02"
    assert drone.radio_id == "00:00:00:00:00:03,10.1.1.2"
    assert (base.original, drone.original, rover.original) == (False, True, True)
    assert base.ros == drone.ros == 2
    # A, Z, B, B, C with the repetition
    dtypes = {topic.type: topic.dtype for kind in team.kinds.values() for topic in kind}
    assert dtypes == {"a_msgs/A": 0, "a_msgs/Z": 1, "b_msgs/B": 2, "c_msgs/C": 4}
    notices = [f"{n.line}:{n.column}: {n.message}" for n in result.notices]
    assert {n.code for n in result.notices} == {"left-out", "radio-shared", "not-read"}
    assert notices == [
        "2:28: 'ghost' is no robot here; its port stays unused",
        "4:13: '12' is no robot here; its port stays unused",
        "4:17: 'rover' does not list 'drone', so the two never sync; its port stays unused",
        "4:30: 'rover' is listed before; its port stays unused",
        "4:37: 'ghost' is no robot here; its port stays unused",
        "5:69: base has this radio as well; others cannot tell them apart",
        "6:22: 'spare-key' is not read by the original nodes",
    ]
    assert team_of(result.text).robots == dict(team.robots)


@pytest.mark.parametrize(("name", "old", "new", "complaint"), REFUSED)
def test_what_is_refused_has_its_place(files, name, old, new, complaint):
    with pytest.raises(DocumentError) as caught:
        files([(name, TEXTS[name] if old == "*" else old, new)])
    assert complaint in str(caught.value)


def test_too_many(files):
    many = "".join(
        f"  - {{msg_topic: /{n}, msg_type: a/B, msg_priority: NO_PRIORITY}}\n" for n in range(255)
    )
    with pytest.raises(DocumentError, match="260 topics, at most 256 have ids"):
        files([("topics", "phantom:\n", f"phantom:\n{many}")])
    robot = "node-type: aerial, using-radio: b-2, IP-address: a, base-port: 1, clients: []"
    many = "".join(f"r{n}: {{{robot}}}\n" for n in range(257))
    with pytest.raises(DocumentError, match="must have at most 256 entries"):
        files([("robots", TEXTS["robots"], many)])
    addresses = ", ".join(f'"00:00:00:00:01:{n:02x}"' for n in range(9))
    result = files([("radios", '"00:00:00:00:00:03"', addresses)])
    assert result.team.robot("drone").radio_id.count(":") == 35  # seven of them
    assert "too many addresses" in str(result.notices[0])


def test_the_command(tmp_path, capsys):
    folder = DATA / "upstream"
    team = tmp_path / "team.yaml"
    files = [str(folder / "robot_configs.yaml"), str(folder / "topic_configs.yaml")]
    assert main(["import", *files, "-o", str(team), "--ours", "titan", "io"]) == 0
    assert capsys.readouterr().out == ""
    assert main(["check", str(team)]) == 0
    assert "titan:23236" in capsys.readouterr().out
    assert [name for name, robot in Team.load(team).robots.items() if not robot.original] == [
        "io",
        "titan",
    ]
    assert main(["import", *files, "-o", str(team)]) == 1
    assert "File exists; choose another file" in capsys.readouterr().err
    assert main(["import", *files]) == 0
    assert "original: true" in capsys.readouterr().out
    assert main(["import", files[1], files[0]]) == 3
    assert "topic_configs.yaml:" in capsys.readouterr().err
    assert main(["import", *files, "--ours", "phantom"]) == 2


@pytest.mark.parametrize(
    ("build", "options", "ros"),
    [("ament_cmake", [], 2), ("catkin", [], 1), ("catkin", ["--ros", "2"], 2), (None, [], 1)],
)
def test_a_package_has_all_files_and_states_which_ros_it_is_for(
    build, options, ros, tmp_path, capsys
):
    package = tmp_path / "mocha_core"
    shutil.copytree(DATA / "upstream", package / "config")
    if build:
        (package / "package.xml").write_text(f"<buildtool_depend>{build}</buildtool_depend>")
    for path in (package, package / "config", package / "config" / "robot_configs.yaml"):
        assert main(["import", str(path), *options]) == 0
        team = team_of(capsys.readouterr().out)
        assert {robot.ros for robot in team.robots.values()} == {ros}
    (package / "config" / "radio_configs.yaml").write_text(TEXTS["radios"])
    assert main(["import", str(package), *options]) == 3
    assert "no radio 'blue-1' in the radio file" in capsys.readouterr().err
