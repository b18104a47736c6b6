import os
import subprocess
import sys

import pytest

from air_router.sim import ports

FIRST = 32_000 + 3 * (os.getpid() % 250)  # a run of these tests beside this one has its own
OTHER = f"""
from air_router.sim import ports
ports.PORTS = range({FIRST}, {FIRST + 3})
print(ports.free_port(), flush=True)
input()
"""


@pytest.mark.skipif(sys.platform != "linux", reason="reserved on Linux only")
def test_two_processes_are_never_given_the_same_port(monkeypatch):
    monkeypatch.setattr(ports, "PORTS", range(FIRST, FIRST + 3))
    with subprocess.Popen(
        [sys.executable, "-c", OTHER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        theirs = int(other.stdout.readline())
        ours = {ports.free_port(), ports.free_port()}
        assert ours | {theirs} == set(ports.PORTS)
        with pytest.raises(OSError, match=f"no port from {FIRST} to {FIRST + 2} is free"):
            ports.free_port()
        other.communicate("\n")
    assert ports.free_port() == theirs
