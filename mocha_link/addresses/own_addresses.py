"""When the addresses of this machine change: by DHCP, another access point, a cable."""

from __future__ import annotations

import contextlib
import socket

from mocha_link.forks import closed_in_children

_IPV4_IFADDR, _IPV6_IFADDR = 0x10, 0x100  # groups of linux/rtnetlink.h
_BYTES = 65_536


class OwnAddresses:
    """The kernel's announcements of changed addresses. There are none outside of Linux.

    Attributes:
        number: the descriptor to wait for; None: there are no announcements.
    """

    def __init__(self) -> None:
        self._socket: socket.socket | None = None
        self.number: int | None = None
        with contextlib.suppress(OSError, AttributeError):  # not Linux, or a sandbox forbids it
            self._socket = closed_in_children(
                socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, socket.NETLINK_ROUTE)
            )
            self._socket.setblocking(False)
            self._socket.bind((0, _IPV4_IFADDR | _IPV6_IFADDR))
            self.number = self._socket.fileno()

    def changed(self) -> bool:
        """Whether an address came or went since the last call."""
        changed = False
        while self._socket:
            try:
                self._socket.recv(_BYTES)
            except BlockingIOError:
                break
            except OSError:  # more announcements than the kernel keeps
                changed = True
                break
            changed = True
        return changed

    def close(self) -> None:
        """Receive no more."""
        if self._socket:
            self._socket.close()
