"""Several flights at once: what they print, their reports, Ctrl-C, and the exit code for all."""

import io
import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from air_router.errors import ExitCode
from air_router.sim.flights import Flights, StatusBlock

WAITS = """
import signal, sys
def leave(*_):
    print('{"outcome": "interrupted"}')
    sys.stderr.write(sys.argv[1] + " holds\\n")
    sys.exit(130)
signal.signal(signal.SIGINT, leave)
sys.stderr.write(sys.argv[1] + " ready\\n")
sys.stderr.flush()
while True:
    signal.pause()
"""
ENDS = """
import os, sys
sys.stderr.write("one\\n\\ntwo\\n")
print('{"outcome": "done"}' + " " * 200_000)
sys.stdout.flush()
if sys.argv[1] == "killed":
    os.kill(os.getpid(), 9)
sys.exit(int(sys.argv[1]))
"""


class Screen(io.StringIO):
    def __init__(self, *, tty=False, when=lambda _text: None):
        super().__init__()
        self._tty, self._when = tty, when

    def isatty(self):
        return self._tty

    def write(self, text):
        super().write(text)
        self._when(self.getvalue())
        return len(text)


def run(script, arguments, screen=None):
    flights = Flights(
        {name: [argument] for name, argument in arguments.items()},
        screen or Screen(),
        io.StringIO(),
        program=(sys.executable, "-c", script),
    )
    return flights, flights.run()


@pytest.mark.parametrize(
    ("ends", "worst"),
    [
        (("0", "0"), ExitCode.DONE),
        (("0", "killed"), ExitCode.ENDED_OTHERWISE),
        (("4", "1"), ExitCode.NO_VEHICLE),
        (("5", "130"), ExitCode.INTERRUPTED),
        (("0", "7"), ExitCode.MISSING_EXTRA),
    ],
)
def test_all_are_waited_for_and_the_worst_exit_code_counts(ends, worst):
    screen = Screen()
    flights, code = run(ENDS, dict(zip(("titan", "io"), ends, strict=True)), screen)
    assert code is worst
    assert [flight.report for flight in flights.flights] == [{"outcome": "done"}] * 2
    lines = screen.getvalue().splitlines()
    assert [line for line in lines if line.startswith("titan")] == ["titan  one", "titan  two"]
    assert [line for line in lines if line.startswith("io")] == ["io     one", "io     two"]


def test_what_a_flight_leaves_behind_is_not_waited_for(tmp_path):
    leaves = (
        "import pathlib, subprocess, sys\n"
        "left = subprocess.Popen(['sleep', '600'])\n"
        "pathlib.Path(sys.argv[1]).write_text(str(left.pid))"
    )
    flights, code = run(leaves, {"titan": str(tmp_path / "pid")})
    os.kill(int((tmp_path / "pid").read_text()), signal.SIGKILL)  # it is still there
    assert code is ExitCode.DONE
    assert flights.flights[0].report == {}


def test_ctrl_c_reaches_all_of_them_once():
    pressed = []

    def press(text):
        if text.count("ready") == 2 and not pressed:
            pressed.append(True)
            os.kill(os.getpid(), signal.SIGINT)

    screen = Screen(when=press)
    before = signal.getsignal(signal.SIGINT)
    flights, code = run(WAITS, {"titan": "titan", "io": "io"}, screen)
    assert code is ExitCode.INTERRUPTED
    assert signal.getsignal(signal.SIGINT) is before
    assert "titan  titan holds" in screen.getvalue()
    assert "io     io holds" in screen.getvalue()
    assert {flight.report["outcome"] for flight in flights.flights} == {"interrupted"}


def test_the_block_is_drawn_anew_below_printed_lines(monkeypatch):
    monkeypatch.setenv("COLUMNS", "40")
    screen = Screen(tty=True)
    block = StatusBlock(("titan", "io"), screen)
    block.show("titan", "READY")
    block.show("io", "x" * 100)
    block.print_line("io", "found")
    block.end()
    drawn = screen.getvalue()
    assert drawn.startswith("titan  READY\r\x1b[Jtitan  READY\nio     xxx")
    assert drawn.endswith("\r\x1b[1A\x1b[Jio     found\ntitan  READY\nio     " + "x" * 32 + "\n")
    assert max(map(len, drawn.replace("\r", "\n").splitlines())) < 40


def test_without_a_terminal_lines_are_printed_and_nothing_is_drawn_over():
    screen = Screen()
    block = StatusBlock(("titan", "io"), screen)
    block.show("titan", "READY")
    block.print_line("titan", "found")
    block.end()
    assert screen.getvalue() == "titan  found\n"


def test_every_line_that_is_typed_at_once_is_read_by_itself():
    """As a flight reads it: a line whenever there is something to read."""
    reads = """
import os, sys, time
sys.stderr.write("ready\\n")
time.sleep(1.0)
for _ in range(2):
    sys.stderr.write(f"read {os.read(0, 1000)}\\n")
"""
    typist, terminal = os.openpty()
    typed = []

    def type_it(text):
        if "ready" in text and not typed:
            typed.append(os.write(typist, b"\x04h\xf6ld\nhome\n"))  # Ctrl-D ends nothing

    screen = Screen(tty=True, when=type_it)
    with os.fdopen(typist), os.fdopen(terminal) as keyboard:
        flights = Flights({"titan": []}, screen, keyboard, program=(sys.executable, "-c", reads))
        assert flights.run() is ExitCode.DONE
    lines = screen.getvalue().replace("\r", "\n").splitlines()
    assert ["b'home" in line for line in lines if "read b" in line] == [False, True]


def open_files():
    return {int(each.name) for each in Path("/proc/self/fd").iterdir()}


@pytest.mark.parametrize("tty", [False, True])
@pytest.mark.parametrize(
    "fails", [(tempfile, "TemporaryFile"), (subprocess, "Popen")], ids=["file", "program"]
)
def test_a_flight_that_cannot_be_started_leaves_nothing_running_and_nothing_open(
    monkeypatch, tty, fails
):
    module, name = fails
    works, started = getattr(module, name), []

    def the_second_fails(*args, **options):
        if started:
            raise OSError("no more of them")
        started.append(works(*args, **options))
        return started[-1]

    processes, popen = [], subprocess.Popen
    monkeypatch.setattr(
        subprocess, "Popen", lambda *a, **o: processes.append(popen(*a, **o)) or processes[-1]
    )
    if module is subprocess:
        works = subprocess.Popen
    monkeypatch.setattr(module, name, the_second_fails)
    before = open_files()
    with pytest.raises(OSError, match="no more of them"):
        Flights(
            {"titan": ["titan"], "io": ["io"]},
            Screen(tty=tty),
            io.StringIO(),
            program=(sys.executable, "-c", WAITS),
        )
    assert [process.poll() for process in processes] == [-signal.SIGKILL]
    assert open_files() == before
