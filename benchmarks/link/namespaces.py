"""A network namespace of one's own, with one interface whose cable is a file descriptor."""

import contextlib
import ctypes
import errno
import fcntl
import os
import signal
import socket
import struct
from pathlib import Path

INTERFACE = "radio0"
MTU_BYTES = 1500

_CLONE_NEWUSER, _CLONE_NEWNET = 0x10000000, 0x40000000
_TUNSETIFF, _IFF_TUN_NO_PI = 0x400454CA, 0x1001
_SIOCSIFADDR, _SIOCSIFNETMASK = 0x8916, 0x891C
_SIOCGIFFLAGS, _SIOCSIFFLAGS, _SIOCSIFMTU = 0x8913, 0x8914, 0x8922
_PR_SET_PDEATHSIG, _PR_SET_TIMERSLACK = 1, 29
_IFF_UP_RUNNING = 0x1 | 0x40


class EmulationError(Exception):
    """This machine does not let us emulate links."""


def enter() -> None:
    """Move this process into a network namespace of its own; it must have one thread only.

    Works without root where user namespaces are allowed, with root everywhere.

    Raises:
        EmulationError: the kernel or a container's rules forbid it.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    user, group = os.getuid(), os.getgid()
    if libc.unshare(_CLONE_NEWUSER | _CLONE_NEWNET) == 0:
        Path("/proc/self/setgroups").write_text("deny", encoding="ascii")
        Path("/proc/self/uid_map").write_text(f"0 {user} 1", encoding="ascii")
        Path("/proc/self/gid_map").write_text(f"0 {group} 1", encoding="ascii")
    elif libc.unshare(_CLONE_NEWNET) != 0:
        why = os.strerror(ctypes.get_errno())
        raise EmulationError(
            f"no network namespace of our own: {why}; allow unprivileged user namespaces "
            "(sysctl kernel.unprivileged_userns_clone=1, or kernel.apparmor_restrict_"
            "unprivileged_userns=0), or run as root"
        )
    # Router solicitations and the like are traffic that no program requested.
    for which in ("default", "all"):
        path = Path(f"/proc/sys/net/ipv6/conf/{which}/disable_ipv6")
        if path.exists():
            path.write_text("1", encoding="ascii")


def end_with_parent() -> None:
    """Nothing is left running when the command is killed."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)


def be_punctual() -> None:
    """Have this process run as soon as it wants to, if we may: the radio does not wait for cores.

    Children do not inherit it; the nodes share the cores like other programs.
    """
    policy = os.SCHED_RR | os.SCHED_RESET_ON_FORK
    with contextlib.suppress(OSError):  # not root: the results show how late it was
        os.sched_setscheduler(0, policy, os.sched_param(1))
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, 1000, 0, 0, 0)


def open_interface(address: str) -> int:
    """Make the namespace's interface and return its other end: IP packets are read and written.

    Raises:
        EmulationError: there is no /dev/net/tun for us.
    """
    try:
        tun = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
        fcntl.ioctl(tun, _TUNSETIFF, struct.pack("16sH22x", INTERFACE.encode(), _IFF_TUN_NO_PI))
    except OSError as error:
        hint = (
            "load it with 'modprobe tun'"
            if error.errno in (errno.ENOENT, errno.ENODEV)
            else ("make it readable and writable for you, or run as root")
        )
        raise EmulationError(f"/dev/net/tun: {os.strerror(error.errno or 0)}; {hint}") from None
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
        _set(control, INTERFACE, _SIOCSIFADDR, _sockaddr(address))
        _set(control, INTERFACE, _SIOCSIFNETMASK, _sockaddr("255.255.255.0"))
        _set(control, INTERFACE, _SIOCSIFMTU, struct.pack("i", MTU_BYTES))
        for name in ("lo", INTERFACE):
            _raise(control, name)
    return tun


def raise_loopback() -> None:
    """Let the namespace's programs reach each other at 127.0.0.1."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
        _raise(control, "lo")


def _raise(control: socket.socket, name: str) -> None:
    answer = fcntl.ioctl(control, _SIOCGIFFLAGS, struct.pack("16s24x", name.encode()))
    flags = struct.unpack_from("H", answer, 16)[0] | _IFF_UP_RUNNING
    _set(control, name, _SIOCSIFFLAGS, struct.pack("H", flags))


def congestion_control() -> str:
    """Which TCP congestion control the emulated machines use: this machine's default."""
    path = Path("/proc/sys/net/ipv4/tcp_congestion_control")
    return path.read_text(encoding="ascii").strip() if path.exists() else "unknown"


def _set(control: socket.socket, name: str, request: int, value: bytes) -> None:
    fcntl.ioctl(control, request, struct.pack("16s24s", name.encode(), value))


def _sockaddr(address: str) -> bytes:
    return struct.pack("=HH4s8x", socket.AF_INET, 0, socket.inet_aton(address))
