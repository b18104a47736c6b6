"""docs/tutorial.md is done as it stands there, flight included: `make docs-test`.

Its blocks run in the order of the page in a copy of the project's folder; the one with `air-router
sim` runs beside the others. Only ports are changed, so that two can run at the same time.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import socket
import subprocess
import time
import urllib.request

import pytest

from air_router.sim.ports import free_port
from tests.docs.blocks import ROOT, blocks

STEPS = [block for block in blocks() if block.page.name == "tutorial.md"]
PATIENCE_S = 240


@pytest.fixture
def home(tmp_path):
    """The project's folder as a newcomer finds it; the environment is the one that is there."""
    names = "missions packaging Makefile pyproject.toml constraints.txt README.md"
    for name in names.split():
        copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy2
        copy(ROOT / name, tmp_path / name)
    (tmp_path / ".venv").symlink_to(ROOT / ".venv")
    (tmp_path / ".venv" / ".ready").touch()
    return tmp_path


class Walk:
    """A user at two terminals in a folder."""

    def __init__(self, folder):
        self.folder = folder
        self.web = str(free_port(socket.SOCK_STREAM))
        self.flight = None
        self.log = folder / "flight.log"

    def begin(self, text, out):
        text = text.replace("--web", f"--web {self.web}")
        script = f"set -e\n[ -f .venv/bin/activate ] && . .venv/bin/activate\n{text}"
        return subprocess.Popen(
            ["bash", "-c", script],
            cwd=self.folder,
            env={**os.environ, "XDG_STATE_HOME": str(self.folder / "state")},
            text=True,
            stdout=out,
            stderr=subprocess.STDOUT,
        )

    def run(self, text):
        process = self.begin(text, subprocess.PIPE)
        out, _ = process.communicate(timeout=PATIENCE_S)
        return process.returncode, out

    def until(self, text, good=bool):
        """Repeat as a person would: a flight that is not in the air yet refuses."""
        ends_s = time.monotonic() + PATIENCE_S
        while True:
            code, out = self.run(text)
            if code == 0 and good(out):
                return out
            assert time.monotonic() < ends_s, out
            assert self.flight.poll() is None, self.log.read_text()

    def fly(self, text):
        with self.log.open("w") as out:
            self.flight = self.begin(f"exec {text}", out)
        self.until("air-router ask status --json", lambda out: json.loads(out)["state"] == "INIT")
        with urllib.request.urlopen(f"http://127.0.0.1:{self.web}", timeout=10) as page:
            assert b"<html" in page.read()

    def step(self, line):
        if line.startswith("air-router ask"):
            out = self.until(line)
            if line.endswith("home"):
                assert self.flight.wait(PATIENCE_S) == 0
            return out
        code, out = self.run(line)
        assert code == 0, out
        return out

    def close(self):
        if self.flight is not None and self.flight.poll() is None:
            self.flight.terminate()
            self.flight.wait(30)


@pytest.mark.timeout(3 * PATIENCE_S)
def test_the_tutorial(home):
    began_s = time.monotonic()
    printed = []
    with contextlib.closing(Walk(home)) as walk:
        for block in STEPS:
            assert block.language == "sh"
            if block.text.startswith("air-router sim"):
                walk.fly(block.text)
            else:
                printed += map(walk.step, block.commands)
    took_s = time.monotonic() - began_s
    out, table = "\n".join(printed), walk.log.read_text()
    assert (home / "route.png").stat().st_size > 10_000
    assert out.count("Pennovation: 39 waypoints") == 2
    assert "9 no-fly zones" in out
    assert out.count("accepted") == 4
    assert "came home: a program's request" in table
    assert "callisto" in table
    assert "the same" in printed[-1]
    assert "crane" in (home / "flight.html").read_text(encoding="utf-8")
    print(f"the tutorial took {took_s:.0f} s")  # noqa: T201 - what the page promises
    assert took_s < 600
