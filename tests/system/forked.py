"""Our programs, each forked off a process that has imported them once.

What a program imports costs it half a second of computing each time, more than most tests
need. A `ForkServer` is that process; what it starts is used as a `subprocess.Popen`.

    python -m tests.system.forked SOCKET

serves requests on the socket with that number, until its other end is closed. Each request is one
packet of JSON with the program's streams, and the socket on which its number and, when it has
ended, its wait status are sent.
"""

import contextlib
import gc
import importlib
import json
import os
import select
import selectors
import signal
import socket
import subprocess
import sys
from functools import cached_property

IMPORTED = (
    "air_router.cli.cli",
    "air_router.cli.edit",
    "air_router.cli.fly",
    "air_router.live.joint",
    "air_router.sim.sim",
    "mocha_link.cli.cli",
    "mocha_link.cli.node_command",
    "sitl.cli.cli",
)
"""With them nearly all that programs of ours need; none of it starts a thread or opens a file."""

_PACKET = 1 << 18


class ForkServer:
    """Starts programs; itself started with the first, and ended with this process.

    Args:
        environment: Of itself, and of what it starts where a request has none.
    """

    def __init__(self, environment):
        self._environment = environment

    @cached_property
    def _requests(self):
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-m", __name__, str(theirs.fileno())],
                stdin=subprocess.DEVNULL,
                env=self._environment,
                pass_fds=[theirs.fileno()],
            )
        return ours

    def start(self, request, streams):
        """Start a program, see `become`; the socket with its status."""
        packet = json.dumps({"env": self._environment, **request}).encode()
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            socket.send_fds(self._requests, [packet], [*streams, theirs.fileno()])
        return ours

    def close(self):
        """End it; what it has started goes on."""
        if "_requests" in vars(self):
            self._requests.close()
            self._process.wait()
            del self._requests


class ForkedProgram:
    """One program, as far as tests use it like a `subprocess.Popen`.

    Args:
        server: That starts it.
        request: What, as `become` takes it.
        stdin: A file number, or `subprocess.DEVNULL`.
    """

    def __init__(self, server, request, stdin):
        self.returncode = None
        with contextlib.ExitStack() as stack:
            if stdin == subprocess.DEVNULL:
                stdin = os.open(os.devnull, os.O_RDONLY)
                stack.callback(os.close, stdin)
            (out, theirs), (err, also_theirs) = os.pipe(), os.pipe()
            self.stdout, self.stderr = os.fdopen(out, "rb"), os.fdopen(err, "rb")
            for end in (theirs, also_theirs):
                stack.callback(os.close, end)
            self._status = server.start(request, [stdin, theirs, also_theirs])
        self.pid = int(self._status.recv(_PACKET))

    def poll(self):
        """Its exit code, or None."""
        if self.returncode is None and select.select([self._status], [], [], 0.0)[0]:
            self._take()
        return self.returncode

    def wait(self, timeout=None):
        """Its exit code, once it has ended."""
        if self.returncode is None:
            if not select.select([self._status], [], [], timeout)[0]:
                raise subprocess.TimeoutExpired(str(self.pid), timeout)
            self._take()
        return self.returncode

    def _take(self):
        with self._status:
            self.returncode = os.waitstatus_to_exitcode(int(self._status.recv(_PACKET)))

    def send_signal(self, number):
        """Send it a signal, unless it has ended."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self):
        """End it at once."""
        self.send_signal(signal.SIGKILL)

    def communicate(self, timeout=None):
        """Read both streams to their ends; what was in them, once it has ended."""
        printed = {self.stdout: b"", self.stderr: b""}
        with selectors.DefaultSelector() as selector:
            for stream in printed:
                selector.register(stream, selectors.EVENT_READ)
            while selector.get_map():
                ready = selector.select(timeout)
                if not ready:
                    raise subprocess.TimeoutExpired(str(self.pid), timeout)
                for key, _ in ready:
                    chunk = os.read(key.fd, 1 << 16)
                    printed[key.fileobj] += chunk
                    if not chunk:
                        selector.unregister(key.fileobj)
        self.wait(timeout)
        return printed[self.stdout], printed[self.stderr]


def serve(requests):
    """Fork for each request; returns it in the child, and None once there are no more."""
    waking, woken = socket.socketpair()
    waking.setblocking(False)
    woken.setblocking(False)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # it is for the programs
    signal.signal(signal.SIGCHLD, lambda *_: None)
    signal.set_wakeup_fd(woken.fileno())
    running = {}  # the socket for its status, by its number
    while True:
        ready, _, _ = select.select([requests, waking], [], [])
        if waking in ready:
            waking.recv(_PACKET)
            _reap(running)
        if requests not in ready:
            continue
        packet, files, _, _ = socket.recv_fds(requests, _PACKET, 4)
        if not packet:
            return None
        *streams, status = files
        pid = os.fork()
        if pid == 0:
            signal.set_wakeup_fd(-1)
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            signal.signal(signal.SIGINT, signal.default_int_handler)
            for number, stream in enumerate(streams):
                os.dup2(stream, number)
            for number in (*files, *(each.detach() for each in running.values())):
                os.close(number)
            for each in (requests, waking, woken):
                each.close()
            return json.loads(packet)
        for stream in streams:
            os.close(stream)
        running[pid] = socket.socket(fileno=status)
        running[pid].send(str(pid).encode())


def _reap(running):
    while running:
        pid, status = os.waitpid(-1, os.WNOHANG)
        if pid == 0:
            return
        with running.pop(pid) as to, contextlib.suppress(OSError):
            to.send(str(status).encode())


def become(request):
    """Do what a program does.

    Args:
        request: `module` and the `function` of it that is called; `arguments`, those of the
            command line; `cwd`, its folder; `env`, its environment.
    """
    os.chdir(request["cwd"])
    os.environ.clear()
    os.environ.update(request["env"])
    sys.argv = [request["module"], *request["arguments"]]
    # Those of before think that they can be sought in if they were files.
    sys.stdout = open(1, "w", closefd=False)  # noqa: SIM115 - until the end
    sys.stderr = open(2, "w", 1, errors="backslashreplace", closefd=False)  # noqa: SIM115
    sys.exit(getattr(importlib.import_module(request["module"]), request["function"])())


if __name__ == "__main__":
    sys.modules["matplotlib"] = None  # as where there is no extra `plot`
    for name in IMPORTED:
        importlib.import_module(name)
    gc.freeze()  # a collection would copy what is shared
    if (request := serve(socket.socket(fileno=int(sys.argv[1])))) is not None:
        become(request)
