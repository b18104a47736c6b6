"""What docs/robot.md promises, on real sockets: rovers of three kinds in one simulated flight.

One publishes plain JSON, one types of ROS 1, one is a DDS participant with types of ROS 2 behind
its bridge. All are started with the commands of the page, two of them where the vehicle soon
passes.
"""

import re
import shlex

import pytest

pytest.importorskip("rosbags", reason="ROS messages need the extra 'ros'")
pytest.importorskip("cyclonedds", reason="CycloneDDS has no wheel for this machine")

from tests.docs.blocks import blocks

pytestmark = pytest.mark.xdist_group("flights 2")

NEARER = {"47.3985995,8.5456": "47.3981,8.5456", "47.3977,8.5469247": "47.3977,8.5462"}


def shown(folder, domain):
    """The commands of the page, with sockets and a DDS domain of this run."""
    texts = [block.text for block in blocks() if re.fullmatch(r"robot.md sh [12]", block.name)]
    text = "".join(texts).replace("ipc:///tmp/", f"ipc://{folder}/")
    text = re.sub(r"(domain|ros2.py) 7\b", rf"\1 {domain}", text)
    for place, nearer in NEARER.items():
        assert place in text
        text = text.replace(place, nearer)
    return map(shlex.split, text.splitlines())


def test_rovers_of_three_kinds_are_found(command, answered, domain, tmp_path, monkeypatch):
    """And receive the map."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    new, sim, scout, husky, bridge, jackal = shown(tmp_path, domain)
    assert answered(*new[1:])[0] == 0
    mission = tmp_path / "yard" / "mission.yaml"
    mission.write_text(re.sub(r"(init_s|explore_s): \d+", r"\1: 5", mission.read_text()))
    flight = command("air-router", *sim[1:], "--speed=10", "--no-record")
    command("mocha-link", *bridge[1:])
    rovers = [
        command(program.removesuffix(".py").replace("/", "."), *arguments)
        for _, program, *arguments in (scout, husky, jackal)
    ]
    names = {"scout", "husky", "jackal"}
    flight.wait_until(
        lambda printed: set(re.findall(r"COMM (\w+): found", printed)) == names, "that it found all"
    )
    for rover in rovers:
        assert any(re.search(rb"map of [1-9]", line) for line in rover.process.stdout)
    flight.interrupt()
    assert flight.finish()[0] == 130
