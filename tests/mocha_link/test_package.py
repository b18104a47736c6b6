"""What `import mocha_link` gives: every public name, each from its module on its first use."""

import subprocess
import sys

import pytest

import mocha_link


def test_every_public_name_is_there():
    for name in mocha_link.__all__:
        assert getattr(mocha_link, name) is not None
    assert {"Node", "Team", "LinkEvent"} <= set(mocha_link.__all__) <= set(dir(mocha_link))


def test_a_missing_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="module 'mocha_link' has no attribute 'Nodes'"):
        _ = mocha_link.Nodes
    with pytest.raises(ImportError, match="cannot import name 'Nodes' from 'mocha_link'"):
        exec("from mocha_link import Nodes")  # noqa: S102 - as a program would


def test_a_part_does_not_load_the_rest():
    script = (
        "import sys\nfrom mocha_link import Header\n"
        "assert Header.__module__ == 'mocha_link.store.wire'\n"
        "assert not {'numpy', 'pydantic', 'yaml', 'zmq'} & {*sys.modules}\n"
        "from mocha_link import *\n"
        "assert Node.__module__ == 'mocha_link.node.node'\n"
    )
    subprocess.run([sys.executable, "-c", script], check=True)


def test_a_node_needs_no_numpy_and_what_reads_ros_messages_names_the_extra(tmp_path):
    team = tmp_path / "team.yaml"
    team.write_text(
        "robots: {a: {kind: k, address: 127.0.0.1, base_port: 24100, clients: []}}\n"
        "kinds: {k: {topics: [{name: /pose, type: json/Pose}]}}\n"
    )
    script = (
        "import sys\nsys.modules['numpy'] = None\n"
        "from mocha_link import MochaLinkError, Node, Team\n"
        f"with Node(Team.load({str(team)!r}), 'a') as node:\n"
        "    node.publish('/pose', b'{}')\n"
        "    assert node.latest('a', '/pose').data == b'{}'\n"
        "try:\n    import mocha_link.ros.ros\n"
        "except MochaLinkError as error:\n    print(error)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], check=True, capture_output=True, text=True
    )
    assert "needs numpy, which is not installed; run: pip install" in done.stdout
