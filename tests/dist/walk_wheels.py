"""What each extra is for is done with wheels and that extra alone: `make dist-test`.

Each test makes an empty environment, installs the wheels, has a command report that it lacks the
extra's package (exit code 7) and how to install it, runs that, and uses the extra as the docs
say. Nothing of the checkout can be imported there.
"""

import contextlib
import json
import platform
import shutil
import signal
import socket
import sys
import tarfile
import urllib.request
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest
from mcap.reader import make_reader

import mocha_link
from air_router.errors import ExitCode
from tests.dist.wheels import Environment, built, extras
from tests.distributions import ROOT, ROVER, project
from tests.test_distributions import build

MISSION = "missions/pennovation/mission.yaml"
SHORT = ("--speed", "20", "--duration", "40", "--json")


@pytest.fixture(scope="session")
def wheels(tmp_path_factory) -> dict[str, Path]:
    return built(tmp_path_factory.mktemp("wheels"))


@pytest.fixture
def environment(tmp_path, wheels) -> Callable[[str], Environment]:
    def make(distribution: str) -> Environment:
        made = Environment(tmp_path / distribution, wheels, distribution)
        shutil.copytree(ROOT / "missions", made.home / "missions")
        return made

    return make


@pytest.fixture(scope="session")
def record(tmp_path_factory, wheels) -> Path:
    """Of a short flight, flown by the wheels."""
    flying = Environment(tmp_path_factory.mktemp("flying"), wheels, "air-router")
    shutil.copytree(ROOT / "missions", flying.home / "missions")
    flying.install(f"{wheels['air-router']}[sim]")
    flown(flying, MISSION)
    (found,) = flying.home.rglob("*.mcap")
    return found


def flown(there: Environment, mission: str) -> None:
    done = there.run("air-router", "sim", mission, *SHORT)
    assert json.loads(done.stdout)["outcome"] == "done"


# --- what an extra is for


def fly(there: Environment, _: Path) -> None:
    """It gets as far as it can without a vehicle."""
    there.run(
        "air-router", "fly", MISSION, "--connect", "udpin://127.0.0.1:0", code=ExitCode.NO_VEHICLE
    )


def parquet(there: Environment, _: Path) -> None:
    """Beside the experiments' own."""
    there.install("scipy", "matplotlib")
    there.run("sitl", "experiment", "table1", "--seeds", 1, "--rows", "radius_m=5", "ugvs=3")
    assert [*there.home.rglob("results.parquet")]


def learning(there: Environment, _: Path) -> None:
    (there.home / "learn.py").write_text(LEARN)
    assert "True" in there.run("python", "learn.py").stdout


def cluster(there: Environment, _: Path) -> None:
    there.install("scipy")
    command = ("sitl", "experiment", "table1", "--cluster", "tcp://127.0.0.1:1")
    refused = there.run(*command, code=ExitCode.REFUSED)
    assert "no scheduler answers" in refused.stderr


LEARN = """
from sitl.experiment import RunSettings
from sitl.experiment.learning import SeekEnvironment
print(SeekEnvironment(RunSettings()).action_space("uav01").n > 0)
"""


def sim(there: Environment, _: Path) -> None:
    flown(there, MISSION)
    with there.start("sitl", "vehicle", MISSION, "--instance", "77") as vehicle:
        assert json.loads(vehicle.stdout.readline())["ready"] is True
        vehicle.send_signal(signal.SIGTERM)
        assert vehicle.wait(60) == 0
    exploring = there.run(
        "air-router", "sim", "missions/explorers/mission.yaml", *SHORT, code=ExitCode.MISSING_EXTRA
    )
    assert "[experiments]" in exploring.stderr


def plot(there: Environment, _: Path) -> None:
    there.run("air-router", "plan", MISSION, "--from", 1, "--to", 34, "--png", "route.png")
    there.run("air-router", "check", MISSION, "--png", "mission.png")
    for name in ("route.png", "mission.png"):
        assert (there.home / name).read_bytes().startswith(b"\x89PNG")


def web(there: Environment, _: Path) -> None:
    with there.start("air-router", "edit", MISSION, "--port", 0, "--no-open") as editor:
        line = next(line for line in editor.stdout if "http://" in line)
        address = "http://" + line.partition("http://")[2].split()[0]
        with urllib.request.urlopen(address, timeout=60) as answer:
            page = answer.read().decode()
        assert "<html" in page
        (script, *_) = (part.split('"')[0] for part in page.split('src="')[1:])
        address = f"{address.rstrip('/')}/{script.lstrip('/')}"
        with urllib.request.urlopen(address, timeout=60) as answer:  # noqa: S310 - of our own
            assert answer.read()
        editor.send_signal(signal.SIGINT)
        editor.communicate(timeout=60)


def experiments(there: Environment, _: Path) -> None:
    rows = ("--rows", "radius_m=30", "ugvs=3")
    there.run("sitl", "experiment", "table1", "--seeds", 1, *rows, "--out", "out")
    assert (there.home / "out" / "summary.json").is_file()
    absent = "import importlib.util as u; print([u.find_spec(n) for n in ('mavsdk', 'pymavlink')])"
    assert there.run("python", "-c", absent).stdout.strip() == "[None, None]"
    there.run("sitl", "town", "8x6", "--seed", 3, "--goals", 40, "--out", "large")
    assert (there.home / "large" / "town.yaml").is_file()


def foxglove(there: Environment, record: Path) -> None:
    there.run("air-router", "convert", record, "flight.mcap")
    with (there.home / "flight.mcap").open("rb") as file:
        schemas = {schema.name for schema in make_reader(file).get_summary().schemas.values()}
    assert "foxglove.LocationFix" in schemas


TWO_NODES = """
import sys, threading
from pathlib import Path
from mocha_link import MessageStored, Node, Team

team, keys = Team.load(Path("team.yaml")), Path("keys")
came = threading.Event()
with Node(team, "a", keys=keys) as a, Node(team, "b", keys=keys) as b:
    b.subscribe(lambda event: came.set() if isinstance(event, MessageStored) else None)
    a.publish("/pose", b"[1]")
    b.sync("a")
    assert came.wait(60)
    assert b.latest("a", "/pose").data == b"[1]"
    assert b.links()["a"].protected is (sys.argv[1] == "keys")
"""


def two_nodes(there: Environment, protected: str) -> None:
    """The team of docs/team-file.md, at ports that are free."""
    team = (there.home / "missions/two/team.yaml").read_text()
    with contextlib.ExitStack() as stack:
        for port in ("24100", "24200"):
            free = stack.enter_context(socket.socket())
            free.bind(("127.0.0.1", 0))
            team = team.replace(port, str(free.getsockname()[1]))
    (there.home / "team.yaml").write_text(team)
    if protected:
        there.run("mocha-link", "keys", "team.yaml")
    there.run("mocha-link", "check", "team.yaml")
    (there.home / "two.py").write_text(TWO_NODES)
    there.run("python", "two.py", protected)


def keys(there: Environment, _: Path) -> None:
    two_nodes(there, "keys")
    secret = next((there.home / "keys").glob("*.key"))
    assert secret.stat().st_mode & 0o077 == 0


RADIO_STATUS = """
from mocha_link.radios.reports import parse_radio_status
from pymavlink.dialects.v20 import ardupilotmega as dialect

link = dialect.MAVLink(None)
status = dialect.MAVLink_radio_status_message(120, 90, 100, 50, 50, 0, 0)
(reading,) = parse_radio_status(status.pack(link))
assert reading.value == 90.0, reading
"""


def mavlink(there: Environment, _: Path) -> None:
    (there.home / "radio.py").write_text(RADIO_STATUS)
    there.run("python", "radio.py")


def mdns(there: Environment, _: Path) -> None:
    """The same team, whose robots are at no address of the team file."""
    team = (there.home / "missions/two/team.yaml").read_text()
    (there.home / "team.yaml").write_text(team.replace("address: 127.0.0.1, ", ""))
    (there.home / "two.py").write_text(TWO_NODES)
    there.run("python", "two.py", "")


ROS = """
from mocha_link.ros.ros import RosCodec

codec = RosCodec()
for ros in (1, 2):
    data = codec.encode("std_msgs/String", {"data": "hello"}, ros)
    assert codec.decode("std_msgs/String", data, ros).data == "hello"
"""


def ros(there: Environment, _: Path) -> None:
    (there.home / "ros.py").write_text(ROS)
    there.run("python", "ros.py")


def ros2(there: Environment, _: Path) -> None:
    ros(there, _)
    two_nodes(there, "")
    with (
        there.start(
            *("mocha-link", "node", "team.yaml", "--robot", "a"),
            *("--serve", f"ipc://{there.home}/a.node"),
        ) as node,
        there.start(
            *("mocha-link", "bridge", "ros2", "--node", f"ipc://{there.home}/a.node"),
            *("--domain", "77"),
        ) as bridge,
    ):
        assert any("ready" in line for line in bridge.stderr)
        for each in (bridge, node):
            each.send_signal(signal.SIGTERM)
            each.communicate(timeout=60)


class Use(NamedTuple):
    """How to see what an extra is for."""

    lacking: tuple[object, ...]  # a command that reports that it lacks the extra
    does: Callable[[Environment, Path], None]


NODES = {
    "keys": Use(("mocha-link", "keys", "missions/two/team.yaml"), keys),
    "mavlink": Use((), mavlink),
    "mdns": Use((), mdns),
    "ros": Use((), ros),
    "ros2": Use(("mocha-link", "bridge", "ros2", "--node", "ipc:///nowhere"), ros2),
}
USES = {
    "mocha-link": NODES,
    "air-router": {
        **NODES,
        "fly": Use(("air-router", "fly", MISSION), fly),
        "sim": Use(("air-router", "sim", MISSION), sim),
        "plot": Use(("air-router", "check", MISSION, "--png", "m.png"), plot),
        "web": Use(("air-router", "edit", MISSION, "--port", 0, "--no-open"), web),
        "experiments": Use(("sitl", "town", "8x6", "--seed", 3, "--out", "t"), experiments),
        "parquet": Use((), parquet),
        "learning": Use((), learning),
        "cluster": Use((), cluster),
        "foxglove": Use(("air-router", "convert", "RECORD", "flight.mcap"), foxglove),
    },
}
NO_DDS = sys.version_info >= (3, 14) or platform.machine() != "x86_64"


def test_every_extra_has_its_use_here():
    for distribution, uses in USES.items():
        assert set(uses) == extras(distribution)


@pytest.mark.parametrize(
    ("distribution", "extra"),
    [(distribution, extra) for distribution, uses in USES.items() for extra in uses],
)
def test_an_extra_alone_is_requested_installed_as_printed_and_does_what_it_is_for(
    environment, wheels, record, distribution, extra
):
    if extra == "ros2" and NO_DDS:
        pytest.skip("CycloneDDS has no wheels for this Python or processor (docs/install.md)")
    there, use = environment(distribution), USES[distribution][extra]
    if use.lacking:
        program, *arguments = (record if each == "RECORD" else each for each in use.lacking)
        printed = there.run(program, *arguments, code=ExitCode.MISSING_EXTRA)
        there.install_as_printed(printed.stderr)
    else:
        there.install(f"{wheels[distribution]}[{extra}]")
    use.does(there, record)


def test_without_extras_a_mission_is_checked_planned_and_converted(environment):
    there = environment("air-router")
    there.run("air-router", "check", MISSION)
    there.run("air-router", "plan", MISSION, "--from", 1, "--to", 34)
    there.run("air-router", "convert", MISSION, "pennovation.plan")
    assert mocha_link.__version__ in there.run("air-router", "--version").stdout
    lacking = there.run("air-router", "sim", MISSION, code=ExitCode.MISSING_EXTRA)
    assert "[sim]" in lacking.stderr
    lacking = there.run("air-router", "fly", MISSION, code=ExitCode.MISSING_EXTRA)
    assert "[fly]" in lacking.stderr


def test_without_extras_two_nodes_meet(environment):
    there = environment("mocha-link")
    two_nodes(there, "")
    assert mocha_link.__version__ in there.run("mocha-link", "--version").stdout


def test_robots_explore_with_the_extras_of_both(environment, wheels):
    there = environment("air-router")
    there.install(f"{wheels['air-router']}[sim,experiments]")
    flown(there, "missions/explorers/mission.yaml")


@pytest.mark.parametrize("source", [ROOT, ROVER], ids=["air-router", "mocha-link"])
def test_a_source_archive_is_small_makes_the_same_wheel_and_has_no_tests(source, wheels, tmp_path):
    archive = build("sdist", source, tmp_path)
    with tarfile.open(archive) as file:
        names = file.getnames()
        file.extractall(tmp_path, filter="data")
    assert not [name for name in names if "/tests/" in name]
    assert archive.stat().st_size < 3_000_000
    again = build("wheel", archive.with_suffix("").with_suffix(""), tmp_path / "again")
    name = project(source)["name"]
    wanted = {info.filename: info.CRC for info in zipfile.ZipFile(wheels[name]).infolist()}
    found = {info.filename: info.CRC for info in zipfile.ZipFile(again).infolist()}
    assert found == wanted
