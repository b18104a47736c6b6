"""Faults of commit 7f645deb that tests of today cannot show there, in the names of that commit.

    cp tests/data/found_in_7f645deb.py OLD/tests/air_router/test_found.py
    cd OLD && python -m pytest -n 0 tests/air_router/test_found.py

All fail there. The whole list, with the test of today for each, is
docs/evidence/faults-of-7f645deb.csv.
"""

import asyncio
import contextlib
import os
import re
import resource
import shutil
import socket
import subprocess
import sys
from pathlib import Path

from air_router.control.control_server import ControlServer
from air_router.mission.loading import load_mission

ROOT = Path(__file__).parents[2]
MISSION = ROOT / "missions" / "pennovation" / "mission.yaml"
GREETING = b"\xff" + bytes(8) + b"\x7f\x03\x01NULL" + bytes(48)
READY = b"\x04)\x05READY\x0bSocket-Type\0\0\0\x06DEALER\x08Identity\0\0\0\0"
PART = b"\1\xff" + bytes(255)  # more follow
MOST_BYTES = 64_000_000
HELD = 300


def run(*words):
    done = subprocess.run(
        [sys.executable, "-m", "air_router", *map(str, words)],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    return done.returncode, done.stdout + done.stderr


def peak_bytes():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


async def served(endpoint, attack):
    """What becomes of an attack on the endpoint for requests while it is served."""
    server = ControlServer(endpoint, lambda *_: {})
    server.open()
    serving = asyncio.create_task(server.run())
    try:
        return await asyncio.to_thread(attack, server.endpoint)
    finally:
        serving.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await serving
        server.close()


def test_a_message_whose_parts_never_end_costs_its_sender_the_connection(tmp_path):
    def attack(endpoint):
        before = peak_bytes()
        with socket.socket(socket.AF_UNIX) as hostile:
            hostile.connect(endpoint.removeprefix("ipc://"))
            sent = 0
            with contextlib.suppress(ConnectionError):
                hostile.sendall(GREETING)
                greeted = b""
                while len(greeted) < len(GREETING + READY):  # its own
                    greeted += hostile.recv(1000)
                hostile.sendall(READY)
                while sent < MOST_BYTES:
                    sent += hostile.send(PART * 200)
        return sent, peak_bytes() - before

    sent, grown = asyncio.run(served(f"ipc://{tmp_path}/s", attack))
    assert sent < MOST_BYTES, f"{sent} bytes of one message were taken, {grown} bytes more are used"


def test_connections_to_the_endpoint_for_requests_are_bounded():
    def attack(endpoint):
        host, port = endpoint.removeprefix("tcp://").split(":")
        with contextlib.ExitStack() as stack:
            held = [
                stack.enter_context(socket.create_connection((host, int(port))))
                for _ in range(HELD)
            ]
            answered = 0
            for each in held:
                each.settimeout(2.0)
                with contextlib.suppress(OSError):
                    answered += bool(each.recv(10))  # its greeting
        return answered

    answered = asyncio.run(served("tcp://127.0.0.1:*", attack))
    assert answered < HELD, f"all {answered} connections are held"


def test_a_faster_mission_keeps_farther_away(tmp_path):
    margin_m = load_mission(MISSION).planning_airspace.margin_m
    faster = shutil.copytree(MISSION.parent, tmp_path / "faster") / "mission.yaml"
    faster.write_text(re.sub(r"(?m)^speed_m_s:.*$", "speed_m_s: 8", MISSION.read_text()))
    assert load_mission(faster).planning_airspace.margin_m > margin_m


def test_check_says_what_clearance_is_to_be_expected():
    code, said = run("check", MISSION)
    assert code == 0
    assert "expected" in said, said


def test_a_folder_for_logs_that_cannot_be_used_is_a_refusal(tmp_path):
    file = tmp_path / "file"
    file.write_text("")
    code, said = run("sim", MISSION, "--log-dir", file / "logs")
    assert code == 5, said
