"""`mocha-link monitor`: what is on the screen, and how it behaves on a real (pseudo) terminal."""

import contextlib
import fcntl
import json
import os
import pty
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import time

import pytest
import zmq
from hypothesis import given
from hypothesis import strategies as st

from mocha_link.cli import monitor_command
from mocha_link.cli.cli import main
from mocha_link.cli.links_view import NodeView, Style
from mocha_link.links.metrics import LinkMetrics, LinkState
from mocha_link.links.reading import Reading, Unit
from mocha_link.service.server import MetricsServer, as_fields
from tests.mocha_link.libzmq import bind

WAIT_S = 60
ENTER, LEAVE = "\x1b[?1049h\x1b[?25l", "\x1b[?25h\x1b[?1049l"
T = 1_795_175_900.0
PLAIN = Style(colour=False)
IO = LinkMetrics(
    "io",
    state=LinkState.STARTED,
    last_sync_in_s=T - 3.5,
    last_sync_out_s=T - 640,
    rtt_smoothed_s=0.0513,
    bandwidth_bytes_s=125_000.0,
    signal=Reading(-61.2, Unit.DBM, "wifi"),
    bytes_in=12_345_678,
    bytes_out=930,
    timeouts=2,
    refused=7,
    newest_age_s=1.25,
    topic_ages_s={"/path": 90_000.0, "/pose": 1.25},
    path="udp",
    protected=True,
)
EUROPA = LinkMetrics(
    "europa",
    state=LinkState.TIMED_OUT,
    bandwidth_bytes_s=1_000.0,
    signal=Reading(31, Unit.DEVICE, "rajant"),
)


def size(columns, rows):
    return os.terminal_size((columns, rows))


def snapshot(*links, robot="titan", at_s=T):
    return {"robot": robot, "at_s": at_s, "links": {link.peer: as_fields(link) for link in links}}


def event(**fields):
    return {"event": "RssiChanged", "peer": "io", "at_s": T, "rssi_dbm": -60.0, **fields}


def picture(*links):
    found = NodeView("tcp://x:1")
    found.take("links", snapshot(*links), 100.0)
    return found


# What stands on the screen.


def test_the_table():
    lines = picture(IO, EUROPA).lines(size(150, 20), PLAIN, 100.0)
    assert [line[:79].rstrip() for line in lines] == [
        "links of titan, tcp://x:1",
        "peer    state      path               signal    in  out    RTT  bandwidth/s",
        "io      started    udp key      -61 dBm wifi  3.5s  11m  51 ms   125k ████████",
        "europa  timed_out  -        31 device rajant     -    -      -   1.0k ██▍",
    ]
    assert [line[79:].split() for line in lines[1:]] == [
        ["got", "gave", "broken", "refused", "newest", "by", "topic"],
        ["12.3M", "930B", "2", "7", "1.2s", "/pose", "1.2s", "/path", "25h"],
        ["0B", "0B", "0", "0", "-", "-"],
    ]


def test_rows_fit_any_width():
    it = picture(IO, EUROPA)
    for width in range(1, 160):
        lines = it.lines(size(width, 20), PLAIN, 100.0)
        assert all(len(line) <= width for line in lines)
    heads = it.lines(size(60, 20), PLAIN, 100.0)[1].split()
    assert heads == ["peer", "state", "signal", "in", "out", "newest"]
    assert it.lines(size(10, 20), PLAIN, 100.0)[1] == "peer"
    for rows in range(1, 8):
        assert len(it.lines(size(80, rows), PLAIN, 100.0)) <= max(1, rows - 1)


def test_ages_grow_without_updates():
    it = picture(IO)
    assert "3.5s" in it.lines(size(150, 20), PLAIN, 100.0)[2]
    assert "5.5s" in it.lines(size(150, 20), PLAIN, 102.0)[2]
    assert it.lines(size(150, 20), PLAIN, 102.0)[2].split()[-5:] == [
        *("3.2s", "/pose", "3.2s", "/path", "25h")
    ]
    lines = it.lines(size(150, 20), Style(), 109.0)
    assert lines[0].startswith("\x1b[31mNO DATA FOR 9 s  links of titan")


def test_events_fill_the_room_below():
    it = picture(IO)
    for number in range(300):
        it.take("event", event(rssi_dbm=float(-number)), 100.0)
    lines = it.lines(size(80, 10), PLAIN, 100.0)
    assert lines[3] == ""
    assert lines[4:] == [
        f"11:58:20.000Z RssiChanged io rssi_dbm=-{number}.000" for number in range(295, 300)
    ]


def test_what_the_table_shows_is_no_event_line():
    it = picture(IO)
    nothing, some = (event(event="SyncEnded", direction="in", messages=n) for n in (0, 2))
    for fields in (
        event(event="SyncStarted"),
        nothing,
        nothing,
        some,
        {**nothing, "complete": False},
    ):
        it.take("event", fields, 100.0)
    lines = it.lines(size(100, 20), PLAIN, 100.0)[4:]
    assert [line.partition("messages=")[2] for line in lines] == ["0", "2", "0 complete=False"]


def test_nothing_that_a_terminal_obeys_gets_through():
    it = NodeView("tcp://x:1")
    evil = LinkMetrics("a\x1b]0;x\x07", topic_ages_s={"/\x1b[2J": 1.0}, path="\r\n")
    it.take("links", snapshot(evil, robot="\x1b[31m"), 0.0)
    it.take("event", event(peer="\x9b5m"), 0.0)
    for line in it.lines(size(200, 20), PLAIN, 0.0):
        assert line.isprintable()


@given(
    st.sampled_from(["links", "event", "?"]),
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
        lambda inner: st.lists(inner, max_size=2) | st.dictionaries(st.text(max_size=5), inner),
        max_leaves=5,
    ),
    st.sampled_from(["at_s", "robot", "links", *as_fields(IO)]),
)
def test_any_json_is_shown_or_refused(kind, value, key):
    fields = {**snapshot(IO), **event()}
    (fields if key in fields else fields["links"]["io"])[key] = value
    it = NodeView("tcp://x:1")
    try:
        it.take(kind, fields, 0.0)
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError, OSError):
        return
    if it.ready:
        for later_s in (0.0, 5.0):
            it.lines(size(100, 20), PLAIN, later_s)


# On a terminal.


class FakeNode:
    """Serves a metrics stream; sends what a test wants it to."""

    def __init__(self, host):
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.XPUB)
        self._socket.setsockopt(zmq.LINGER, 0)
        self.endpoint = bind(self._socket, f"tcp://{host}:*")

    def send(self, kind, fields):
        self._socket.send_multipart([kind.encode(), json.dumps(fields).encode()])

    def wait(self):
        assert self._socket.poll(WAIT_S * 1000)
        self._socket.recv()

    def close(self):
        self._context.destroy(0)


@pytest.fixture
def fake(field):
    with contextlib.closing(FakeNode(field.host)) as fake:
        yield fake


class Terminal:
    """A pseudo terminal with a command in it, and all that was written there."""

    def __init__(self, command, size):
        self._fd, self.slave = pty.openpty()
        self.settings = termios.tcgetattr(self.slave)
        self.resize(size)
        self.process = subprocess.Popen(
            [sys.executable, "-m", "mocha_link.cli.cli", *command],
            stdin=self.slave,
            stdout=self.slave,
            stderr=self.slave,
            start_new_session=True,
            env={**os.environ, "TERM": "xterm", "PYTHONIOENCODING": "utf-8"},
        )
        self.raw = ""

    def resize(self, size):
        new = struct.pack("HHHH", size.lines, size.columns, 0, 0)
        fcntl.ioctl(self._fd, termios.TIOCSWINSZ, new)

    def press(self, keys):
        os.write(self._fd, keys)

    def wait(self, text, columns=120):
        """Until the last whole picture has a text in it, and no row is longer."""
        deadline_s = time.monotonic() + WAIT_S
        while True:
            picture = self.raw.rpartition("\x1b[J")[0].rpartition("\x1b[H")[2]
            rows = re.sub(r"\x1b\[[\d;]*[a-zA-Z]|\r", "", picture).split("\n")
            if text in picture and all(len(row) <= columns for row in rows):
                return
            assert time.monotonic() < deadline_s, (text, self.raw[-2000:])
            self.read(0.1)

    def read(self, timeout_s):
        if select.select([self._fd], [], [], timeout_s)[0]:
            with contextlib.suppress(OSError):  # EIO: everything that held it has ended
                self.raw += os.read(self._fd, 65536).decode(errors="replace")

    def close(self):
        self.process.kill()
        self.process.wait()
        os.close(self._fd)
        os.close(self.slave)


@pytest.fixture
def terminal(fake):
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # also in the background
    with contextlib.closing(Terminal(["monitor", fake.endpoint], size(120, 12))) as terminal:
        fake.wait()
        fake.send("links", snapshot(IO, EUROPA))
        yield terminal
    signal.signal(signal.SIGINT, before)


def test_live_and_resized(fake, terminal):
    terminal.wait("31 device rajant")
    assert ENTER in terminal.raw
    fake.send("links", snapshot(LinkMetrics("io", state=LinkState.ENDED)))
    fake.send("event", event())
    terminal.wait("RssiChanged io")
    terminal.resize(size(40, 5))
    os.killpg(terminal.process.pid, signal.SIGWINCH)
    fake.send("links", snapshot(IO, EUROPA))
    terminal.wait("europa", columns=40)


@pytest.mark.parametrize(
    ("end", "code"),
    [
        (lambda terminal: terminal.process.send_signal(signal.SIGINT), 130),
        (lambda terminal: terminal.process.send_signal(signal.SIGTERM), 0),
        (lambda terminal: terminal.press(b"xq"), 0),
    ],
)
def test_the_terminal_is_given_back(terminal, end, code):
    terminal.wait("links of titan")
    assert termios.tcgetattr(terminal.slave) != terminal.settings  # keys come at once, unseen
    end(terminal)
    assert terminal.process.wait(WAIT_S) == code
    assert termios.tcgetattr(terminal.slave) == terminal.settings
    terminal.read(1)
    assert terminal.raw.removesuffix("interrupted\r\n").endswith(LEAVE)
    assert "Traceback" not in terminal.raw


def test_without_a_terminal_it_prints_once(field, capsys):
    node, _, _ = field.node("titan")
    with MetricsServer(node, f"tcp://{field.host}:*") as server:
        assert main(["monitor", server.endpoint]) == 0
    out = capsys.readouterr().out
    assert out.startswith(f"links of titan, {server.endpoint}\npeer ")
    assert "\x1b" not in out


def test_no_answer(field, capsys, monkeypatch):
    monkeypatch.setattr(monitor_command, "FIRST_S", 0.05)
    assert main(["monitor", f"tcp://{field.host}:9"]) == 1
    assert "is a node running there with --metrics" in capsys.readouterr().err
