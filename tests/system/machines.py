"""Machines of a test, as network namespaces on one link, and programs that run on them."""

import contextlib
import os
import secrets
import select
import shutil
import subprocess
import sys
import time
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
WAIT_S = 60  # against hangs


def lacking():
    """Why there can be no namespaces here; None: there can."""
    if os.geteuid() != 0:
        return "network namespaces need root"
    if shutil.which("ip") is None:
        return "no ip command (iproute2)"
    name = f"probe-{secrets.token_hex(3)}"
    made = subprocess.run(["ip", "netns", "add", name], capture_output=True, check=False)
    if made.returncode:
        return f"no network namespaces: {made.stderr.decode().strip()}"
    subprocess.run(["ip", "netns", "delete", name], check=True)
    return None


def ip(*arguments):
    subprocess.run(["ip", *arguments], check=True, capture_output=True)


class Machine:
    """A namespace with one interface, `eth0`, on the link of all, which has a namespace too."""

    def __init__(self, stack, link, name):
        self.name = f"{link}-{name}"
        self.hosts = Path("/etc/netns") / self.name / "hosts"
        self._stack = stack
        ip("netns", "add", self.name)
        stack.callback(ip, "netns", "delete", self.name)
        stack.callback(shutil.rmtree, self.hosts.parent, ignore_errors=True)
        self.hosts.parent.mkdir(parents=True)
        self.hosts.write_text("127.0.0.1 localhost\n")
        there = ["peer", "name", "eth0", "netns", self.name]
        ip("-n", link, "link", "add", "name", name, "type", "veth", *there)
        ip("-n", link, "link", "set", "dev", name, "master", "bridge", "up")
        self.ip("link", "set", "lo", "up")
        self.ip("link", "set", "eth0", "up")

    def ip(self, *arguments):
        ip("-n", self.name, *arguments)

    def add(self, address):
        more = ["nodad"] if ":" in address else []
        self.ip("address", "add", address, "dev", "eth0", *more)

    def remove(self, address):
        self.ip("address", "delete", address, "dev", "eth0")

    def knows(self, **names):
        """Change the addresses that host names have on this machine, in place."""
        lines = ["127.0.0.1 localhost", *(f"{each} {name}" for name, each in names.items())]
        self.hosts.write_text("\n".join(lines) + "\n")

    def link_local(self):
        """Its IPv6 address that is valid on this link only."""
        deadline_s = time.monotonic() + WAIT_S
        while time.monotonic() < deadline_s:
            shown = subprocess.run(
                ["ip", "-n", self.name, "-6", "-o", "address", "show", "dev", "eth0"],
                capture_output=True,
                check=True,
                text=True,
            ).stdout
            found = [line for line in shown.splitlines() if "scope link" in line]
            if found and "tentative" not in found[0]:
                return found[0].split()[3].partition("/")[0]
            time.sleep(0.1)
        raise TimeoutError("no link-local address")

    def answer(self, *arguments):
        """What `mocha-link` prints on this machine."""
        command = [sys.executable, "-m", "mocha_link", *arguments]
        done = subprocess.run(
            ["ip", "netns", "exec", self.name, *command],
            capture_output=True,
            check=False,
            text=True,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
        )
        return done.stdout

    def run(self, script, *arguments):
        return Program(self._stack, self.name, script, arguments)


class Program:
    """A program on a machine, whose lines the test reads."""

    def __init__(self, stack, namespace, script, arguments):
        self._rest = b""
        self.process = subprocess.Popen(
            ["ip", "netns", "exec", namespace, sys.executable, str(HERE / script), *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
        )
        stack.callback(self._end)

    def _end(self):
        self.process.kill()
        self.process.wait()
        self.process.stdout.close()
        self.process.stderr.close()

    def line(self, limit_s=WAIT_S):
        """The fields of the next line."""
        deadline_s = time.monotonic() + limit_s
        while b"\n" not in self._rest:
            left_s = deadline_s - time.monotonic()
            if left_s <= 0 or not select.select([self.process.stdout], [], [], left_s)[0]:
                raise TimeoutError(f"no line within {limit_s} s")
            chunk = os.read(self.process.stdout.fileno(), 65536)
            assert chunk, self.process.stderr.read().decode()
            self._rest += chunk
        line, _, self._rest = self._rest.partition(b"\n")
        return line.decode().split()

    def receives(self, robot, after_s=0.0, limit_s=WAIT_S):
        """Wait for what a robot has published after a time; when that was received."""
        deadline_s = time.monotonic() + limit_s
        while True:
            fields = self.line(max(deadline_s - time.monotonic(), 0.0))
            if fields[0] == robot and float(fields[1]) > after_s:
                return float(fields[2])


@contextlib.contextmanager
def machines(*names):
    """So many machines on a link of their own.

    No interface is made on the machine that runs the tests: a browser there would reload its pages
    and drop their connections, because the network has changed.
    """
    link = f"t{secrets.token_hex(3)}"
    with contextlib.ExitStack() as stack:
        ip("netns", "add", link)
        stack.callback(ip, "netns", "delete", link)
        ip("-n", link, "link", "add", "bridge", "type", "bridge", "mcast_snooping", "0")
        ip("-n", link, "link", "set", "bridge", "up")
        yield [Machine(stack, link, name) for name in names]
