"""The commands of the docs that take a while or go on: each is really run, by `make docs-test`.

What serves is started, awaited until it prints that it is ready, and ended with Ctrl-C; what
flies is shortened.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time

import pytest

from tests.docs.blocks import PROGRAMS, ROOT, blocks

SERVES = {  # until it prints this
    "mocha-link node": "ready",
    "sitl vehicle": '"ready": true',
    "air-router edit": "http://",
}
RUNS = {  # to its end; with what makes it shorter
    "air-router sim": ["--duration", "60"],
    "sitl conform": [],
    "sitl rehearse": [],
    "sitl experiment": [],
    "mocha-link metrics": [],
    "mocha-link monitor": [],
}
NOT_HERE = {  # patterns of lines, and why or where else
    r"--px4|sitl px4": "needs a PX4 SITL: tests/system/test_px4.py",
    r"bridge ros[12]": "needs ROS or its middleware: tests/mocha_link/bridges",
    r"--connect|air-router (fly|preflight)": "needs a vehicle: tests/system",
    r"air-router ask": "a flight: walk_tutorial.py",
    r"air-router signing-key": "a vehicle: tests/system/test_signing.py",
    r"air-router ros2": "a flight and DDS: tests/air_router/ros2",
    r"air-router tiles": "a server of tiles: tests/air_router/editor",
    r"air-router watch": "flights elsewhere: tests/air_router/live",
    r"air-router (replay|report)": "a record: walk_tutorial.py, tests/air_router/record",
    r"sitl experiment (?!--list)": "minutes to hours: tests/sitl/experiment runs small ones",
    r"sitl leaderboard|my_policy": "tests/sitl/experiment",
    r"sitl rehearse (?!.*--fault)": "minutes: `make rehearse`",
    r"sitl (conform$|conform --json)": "all conversations: tests/sitl/conformance",
    r"air-router new|--rover": "tests/system/test_rovers.py",
    r"sitl team|/etc/|--keys|--robot boreas": "files of a robot: tests/sitl, tests/mocha_link",
    r"rerun |sim demo": "Rerun, and tests/test_release.py",
    r"--image|--new": "pictures and new files: tests/air_router/editor",
    r"while |--follow|LOG": "no end, or no file of that name",
    r" (check|plan|cover|convert|completion|keys|import) |sitl town|source": "test_snippets.py",
}
LINES = {  # each once, with the first page that has it
    line: block.page.name
    for block in reversed(blocks())
    if block.page.name != "tutorial.md"
    for line in block.commands
    if line.split()[0] in PROGRAMS
}


def verb(line):
    words = line.split()
    return next((v for v in (*SERVES, *RUNS) if words[: len(v.split())] == v.split()), None)


def chosen():
    for line, page in sorted(LINES.items()):
        if not any(re.search(pattern, line) for pattern in NOT_HERE):
            assert verb(line), f"{page}: {line}: add to this file how it is run, or why not"
            yield page, line


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("commands")
    shutil.copytree(ROOT / "missions", folder / "missions")
    for file in (ROOT / "missions" / "pennovation").iterdir():
        shutil.copy(file, folder)
    shutil.copy(folder / "team.yaml", folder / "io.yaml")
    (two,) = (b.text for b in blocks() if b.name == "team-file.md yaml 2")
    (folder / "two.yaml").write_text(two)
    return folder


def begin(line, folder, more=()):
    words = [*line.replace("MISSION", "mission.yaml").split(), *more]
    if (
        "--robot" in words
        and words[words.index("--robot") + 1] in {"a", "b"}
        and "team.yaml" in words
    ):
        words[words.index("team.yaml")] = "two.yaml"
    if words[:2] == ["air-router", "edit"]:
        words += ["--no-open", "--port", "0"]
    program = {"air-router": "air_router", "mocha-link": "mocha_link"}.get(words[0], words[0])
    return subprocess.Popen(
        [sys.executable, "-m", program, *words[1:]],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT), "XDG_STATE_HOME": str(folder / "state")},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def until_ready(process, pattern):
    printed = []
    for line in process.stdout:
        printed.append(line)
        if re.search(pattern, line):
            return
    pytest.fail("".join(printed))


def end(process):
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=60)
    assert process.returncode in {0, 130}


NEEDS = {  # what has to run beside it
    "monitor ipc:///tmp/b.metrics": (
        "mocha-link node missions/two/team.yaml --robot b --metrics ipc:///tmp/b.metrics"
    ),
    "mocha-link metrics": "mocha-link node io.yaml --robot io --metrics tcp://127.0.0.1:24500",
    "mocha-link monitor": "mocha-link node io.yaml --robot io --metrics tcp://127.0.0.1:24500",
}


@pytest.mark.timeout(240)
@pytest.mark.parametrize(("page", "line"), list(chosen()), ids=lambda word: word)
def test_a_command(page, line, folder):
    beside = next((b for pattern, b in NEEDS.items() if pattern in line), None)
    other = begin(beside, folder) if beside else None
    try:
        if other:
            until_ready(other, "ready")
        began_s = time.monotonic()
        process = begin(line, folder, RUNS.get(verb(line), ()))
        try:
            if verb(line) in SERVES:
                until_ready(process, SERVES[verb(line)])
                end(process)
            else:
                out, _ = process.communicate(timeout=200)
                assert process.returncode == 0, out
                assert out
        finally:
            process.kill()
        assert time.monotonic() - began_s < 200
    finally:
        if other:
            end(other)
