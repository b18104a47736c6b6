"""A disk without room: a node's storage heals when its messages have become small."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from mocha_link.store.reserve import RESERVE_BYTES

PROGRAM = Path(__file__).with_name("full_disk_planner.py")
TOPICS = 40
DISK = "3m"


def mounts() -> bool:
    """Whether this machine lets us mount a disk of our own."""
    command = ["unshare", "--mount", "mount", "-t", "tmpfs", "none", "/mnt"]
    return (
        bool(shutil.which("unshare"))
        and not subprocess.run(command, check=False, capture_output=True).returncode
    )


@pytest.mark.skipif(not mounts(), reason="needs the right to mount a small disk (root on Linux)")
@pytest.mark.parametrize("who", ["own", "others"])
def test_storage_heals_on_a_full_disk_when_its_messages_are_replaced_by_small_ones(tmp_path, who):
    """Either the node's messages fill the disk, or files of others do."""
    topics = ", ".join(f"{{name: /t{number}, type: json/Pose}}" for number in range(TOPICS))
    team = tmp_path / "team.yaml"
    team.write_text(
        "robots: {titan: {kind: uav, address: 127.0.0.1, base_port: 24100, clients: []}}\n"
        f"kinds: {{uav: {{topics: [{topics}]}}}}\n"
    )
    disk = tmp_path / "disk"
    disk.mkdir()
    script = 'mount -t tmpfs -o size="$1" none "$2" && shift 2 && exec "$@"'
    program = (sys.executable, str(PROGRAM), str(team), str(disk), who)
    done = subprocess.run(
        ["unshare", "--mount", "sh", "-c", script, "sh", DISK, str(disk), *program],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    seen = json.loads(done.stdout)
    assert seen["reserve"] == RESERVE_BYTES
    assert "no room to write" in seen["fault"]
    assert seen["recovered"] is None
    expected = {f"/t{number}": f"/t{number}" * 50 for number in range(TOPICS)} | {"/t0": "last"}
    assert seen["kept"] == expected
    assert seen["fault after the restart"] is None
    assert seen["reserve again"] is True
