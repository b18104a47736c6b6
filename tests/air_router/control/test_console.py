import asyncio
import os
import pty
import signal
import threading

import pytest

from air_router.control.command_request import parse_command
from air_router.flight.terminal import StatusLine, listening


@pytest.fixture
def terminal():
    master, slave = pty.openpty()
    with os.fdopen(master, "w", buffering=1) as typist, os.fdopen(slave) as keyboard:
        yield typist, keyboard


@pytest.mark.parametrize(
    ("typed", "nonsense"),
    [
        (b"fly me to the moon\n\n Home \n", "no request 'fly'; use one of hold"),
        (b"h\xf6ld\n\x04home\n", "no request 'h\N{REPLACEMENT CHARACTER}ld'"),
    ],
    ids=["words", "of a Latin-1 terminal, then Ctrl-D"],
)
def test_typed_requests_are_submitted_and_nonsense_is_answered(terminal, typed, nonsense):
    typist, keyboard = terminal
    requests, complaints, faults = [], [], []

    async def listen():
        loop, done = asyncio.get_running_loop(), asyncio.Event()
        loop.set_exception_handler(lambda _loop, context: faults.append(context["exception"]))

        def deliver(request):
            requests.append(request)
            done.set()

        with listening(deliver, complaints.append, keyboard):
            os.write(typist.fileno(), typed)
            await asyncio.wait_for(done.wait(), 60)

    asyncio.run(listen())
    assert (requests, faults) == ([parse_command("home")], [])
    (complaint,) = complaints
    assert nonsense in complaint


def test_a_terminal_that_takes_nothing_keeps_nothing_waiting(terminal):
    _, keyboard = terminal
    with os.fdopen(os.dup(keyboard.fileno()), "w") as screen:
        status = StatusLine(screen)
        status.print_line(os.fsdecode(b"fl\xfcge.mcap"))  # a path need not be UTF-8
        for number in range(2_000):  # far more than it buffers, and nothing reads it
            status.print_line(f"line {number} {'x' * 60}")


def test_a_pipe_that_is_not_read_keeps_nothing_waiting():
    read, write = os.pipe()
    os.set_blocking(read, False)
    with os.fdopen(read, "rb") as reader, os.fdopen(write, "w") as pipe:
        status = StatusLine(pipe)
        lines = [f"line {number} {'x' * 60}" for number in range(2_000)]
        writer = threading.Thread(
            target=lambda: [status.print_line(line) for line in lines], daemon=True
        )
        writer.start()
        writer.join(20.0)
        waits, first = writer.is_alive(), reader.read(8)
        while writer.is_alive():
            reader.read()
    assert (waits, first) == (False, b"line 0 x")


def test_a_terminal_stops_no_flight():
    async def fly():
        stops = (signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU)
        before = [signal.getsignal(number) for number in stops]
        with listening(print, print):
            for number in stops:
                os.kill(os.getpid(), number)
        assert [signal.getsignal(number) for number in stops] == before

    asyncio.run(fly())


def test_what_is_no_terminal_is_left_alone(tmp_path):
    (tmp_path / "text").write_text("home\n")

    async def listen():
        with (tmp_path / "text").open() as file, listening(pytest.fail, pytest.fail, file):
            await asyncio.sleep(0)
            assert file.read() == "home\n"

    asyncio.run(listen())
