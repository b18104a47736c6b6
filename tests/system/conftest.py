"""Starts our commands as a user does: as processes, on ports that are free."""

import contextlib
import functools
import io
import json
import os
import re
import select
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
import tomllib
from pathlib import Path
from unittest import mock

import pytest
from pymavlink.dialects.v20 import common as mavlink

import air_router.cli.cli
import sitl.cli.cli
from air_router.sim.ports import free_port
from mocha_link import Team
from sitl.team.derived_team import derive_team
from tests.system.forked import ForkedProgram, ForkServer
from tests.system.looker import SharedBrowser
from tests.system.simulated import simulated_vehicle

ROOT = Path(__file__).parents[2]
PENNOVATION = ROOT / "missions" / "pennovation" / "mission.yaml"
UNDER_TEST = Path(os.environ.get("CHECKOUT_UNDER_TEST", ROOT)).absolute()
"""The checkout whose programs are started; their vehicle, peers and tests are always ours."""

PROGRAMS = {"air-router": air_router.cli.cli, "sitl": sitl.cli.cli}

LIMIT_S = 280.0 if UNDER_TEST == ROOT else 120.0
"""Of the wall's clock, against hangs only: a busy machine is slow."""


def entry_of(name):
    """Module and function of a program of the checkout under test, whatever they are called there.

    No function: its module is run.
    """
    project = tomllib.loads((UNDER_TEST / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    module, _, function = project["scripts"].get(name, name).partition(":")
    return module, function or None


def program(name, *, draws=False):
    """How a program of the checkout under test begins.

    Unless it `draws` it has no extra `plot`: a picture of the track costs a second per flight.
    """
    module, function = entry_of(name)
    if function is None:
        return [sys.executable, "-m", module]
    plain = "" if draws else "sys.modules['matplotlib'] = None; "
    begin = f"import sys; {plain}from {module} import {function}; sys.exit({function}())"
    return [sys.executable, "-c", begin]


def environment():
    more = {"PYTHONUNBUFFERED": "1", "PYTHONFAULTHANDLER": "1"}  # see `where_it_hangs`
    return {**os.environ, "PYTHONPATH": str(UNDER_TEST), **more}


def where_it_hangs(pid):
    """Where the threads of all processes below this one are, by the logs that these leave."""
    dumps = []
    for listed in Path(f"/proc/{pid}/task").glob("*/children"):
        for child in map(int, listed.read_text().split()):
            dumps.append(where_it_hangs(child))
            with contextlib.suppress(OSError):
                log = Path(f"/proc/{child}/fd/2").resolve()
                command = Path(f"/proc/{child}/cmdline").read_text().replace("\0", " ")
                os.kill(child, signal.SIGABRT)
                time.sleep(0.5)
                if log.is_file():
                    dumps.append(f"\n--- {command}\n{log.read_text(errors='replace')[-20_000:]}")
    return "".join(dumps)


_fork_server = ForkServer(environment())


class Command:
    """One of our commands as a process; its stderr is followed line by line.

    It is forked off a process that has imported it, unless it `starts` as a user starts it.
    """

    def __init__(self, name, *arguments, cwd, starts=False, draws=False, stdin=subprocess.DEVNULL):
        arguments, pipe = [*map(str, arguments)], subprocess.PIPE
        module, function = entry_of(name)
        if starts or draws or function is None or UNDER_TEST != ROOT:
            self.process = subprocess.Popen(
                [*program(name, draws=draws), *arguments],
                stdout=pipe,
                stderr=pipe,
                stdin=stdin,
                cwd=cwd,
                env=environment(),
            )
        else:
            request = {"module": module, "function": function, "arguments": arguments}
            where = {"cwd": str(cwd), "env": environment()}
            self.process = ForkedProgram(_fork_server, {**request, **where}, stdin)
        self.printed = ""

    def wait_for(self, text, limit_s=LIMIT_S):
        """Read stderr until a text was printed."""
        self.wait_until(lambda printed: text in printed, repr(text), limit_s)

    def wait_until(self, condition, what, limit_s=LIMIT_S):
        """Read stderr until `condition` holds for all that was printed."""
        deadline_s = time.monotonic() + limit_s
        while not condition(self.printed):
            left_s = deadline_s - time.monotonic()
            ready = left_s > 0 and select.select([self.process.stderr], [], [], left_s)[0]
            chunk = os.read(self.process.stderr.fileno(), 65536) if ready else b""
            if not chunk:
                pytest.fail(
                    f"{what} was not printed; but: {self.printed}{where_it_hangs(self.process.pid)}"
                )
            self.printed += chunk.decode()

    def read(self):
        """Take in what it has printed so far."""
        while select.select([self.process.stderr], [], [], 0.0)[0]:
            chunk = os.read(self.process.stderr.fileno(), 65536)
            if not chunk:
                break
            self.printed += chunk.decode()

    def ready(self):
        """The JSON line that a simulation prints when it is ready."""
        return json.loads(self.process.stdout.readline())

    def interrupt(self):
        self.process.send_signal(signal.SIGINT)

    def finish(self, limit_s=LIMIT_S):
        """Wait for the end; returns exit code and stdout."""
        out, err = self.process.communicate(timeout=limit_s)
        self.printed += err.decode()
        return self.process.returncode, out.decode()


@contextlib.contextmanager
def commands(folder):
    with contextlib.ExitStack() as stack:

        def start(*arguments, **options):
            started = Command(*arguments, cwd=folder, **options)

            def end():
                if started.process.poll() is None:
                    started.process.kill()
                    started.process.wait()
                started.process.stdout.close()
                started.process.stderr.close()

            stack.callback(end)
            return started

        yield start


@pytest.fixture
def command(tmp_path):
    with commands(tmp_path) as start:
        yield start


def answer(folder, *arguments, of="air-router"):
    """What a program answers: exit code, stdout, stderr. Ours is run in this process."""
    arguments, printed = [*map(str, arguments)], (io.StringIO(), io.StringIO())
    if UNDER_TEST != ROOT:
        how = {"cwd": folder, "env": environment(), "stdin": subprocess.DEVNULL, "timeout": 60}
        command = [*program(of), *arguments]
        done = subprocess.run(command, capture_output=True, text=True, check=False, **how)
        return done.returncode, done.stdout, done.stderr
    with (
        contextlib.chdir(folder),
        mock.patch("sys.stdin", io.StringIO()),
        contextlib.redirect_stdout(printed[0]),
        contextlib.redirect_stderr(printed[1]),
    ):
        code = PROGRAMS[of].main(arguments)
    return code, *(text.getvalue() for text in printed)


@pytest.fixture
def answered(tmp_path):
    return functools.partial(answer, tmp_path)


@pytest.fixture(scope="module")
def shared_folder(tmp_path_factory):
    """For what all tests of a module look at."""
    return tmp_path_factory.mktemp("shared")


@pytest.fixture(scope="module")
def shared_command(shared_folder):
    """What it starts ends with the module."""
    with commands(shared_folder) as start:
        yield start


@pytest.fixture(scope="session", autouse=True)
def _end_the_fork_server():
    yield
    _fork_server.close()


_shared_browser = SharedBrowser()


@pytest.fixture(scope="module")
def browser():
    return _shared_browser.get()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(item, nextitem):
    """The browser ends with the last of the files that look at pages."""
    try:
        return (yield)
    finally:
        goes_on = nextitem is not None and (
            nextitem.path == item.path or "browser" in nextitem.fixturenames
        )
        if not goes_on:
            _shared_browser.close()


@pytest.fixture
def udp_port():
    return free_port()


@pytest.fixture
def free_udp_port():
    return free_port


class Heartbeats:
    """A peer that sends heartbeats to a port, and nothing else."""

    def __init__(self, port, *, kind, autopilot, system_id, component_id=1):
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._stop = threading.Event()
        sender = mavlink.MAVLink(None, srcSystem=system_id, srcComponent=component_id)

        def send():
            while not self._stop.wait(0.05):
                frame = sender.heartbeat_encode(kind, autopilot, 0, 0, 3).pack(sender)
                self._socket.sendto(frame, ("127.0.0.1", port))

        self._thread = threading.Thread(target=send)
        self._thread.start()

    def close(self):
        self._stop.set()
        self._thread.join()
        self._socket.close()


@pytest.fixture
def heartbeats():
    """Begins to send heartbeats to a port: `heartbeats(port, kind=, autopilot=, system_id=)`."""
    with contextlib.ExitStack() as stack:

        def start(port, **who):
            stack.callback(Heartbeats(port, **who).close)

        yield start


@pytest.fixture
def vehicle(udp_port, free_udp_port, short_mission):
    """Starts a simulated PX4 that sends to `udp_port`, by default at the mission's home."""
    with contextlib.ExitStack() as stack:

        def start(*more, speed=10):
            vehicle = simulated_vehicle(
                *(more or (short_mission,)),
                f"--speed={speed}",
                f"--api-to=127.0.0.1:{udp_port}",
                "--no-gcs",
                f"--truth-to=127.0.0.1:{free_udp_port()}",
            )
            return stack.enter_context(vehicle)

        yield start


@pytest.fixture
def short_mission(tmp_path):
    return hurry(tmp_path / "mission")


@pytest.fixture(scope="module")
def shared_mission(shared_folder):
    return hurry(shared_folder / "mission")


def hurry(folder):
    """Pennovation in a hurry: times divided by six, the first by 36, flown half as fast again."""
    text = PENNOVATION.read_text(encoding="utf-8")
    for key, slow, fast in (
        ("init_s", "180", "5"),
        ("explore_s", "120", "20"),
        ("search_s", "45", "10"),
        ("speed_m_s", "3.5", "5"),
    ):
        assert f"{key}: {slow}" in text
        text = text.replace(f"{key}: {slow}", f"{key}: {fast}")
    if UNDER_TEST != ROOT:
        text = re.sub(r"(?m)^accepts: .*$", "", text)  # older ones do not know this key
    folder.mkdir()
    shutil.copy(PENNOVATION.parent / "world.yaml", folder)
    derive_team(Team.load(PENNOVATION.parent / "team.yaml"), folder)
    path = folder / "mission.yaml"
    path.write_text(text, encoding="utf-8")
    return path
