"""Addresses of machines: host names, IPv4, and IPv6 with its interface; as text and for sockets.

A *host* is the text between the scheme and the port of a URL, without the brackets of IPv6:
``titan.local``, ``192.168.1.13``, ``fd00::2``, ``fe80::1%wlan0``. One that `is_number` is never
resolved. `socket_address` is what a socket takes, `host_of` what it reports, in the same form.
"""

from __future__ import annotations

import ipaddress
import re
import socket
from typing import Final

ANY: Final = "*"
"""All addresses of a machine, IPv4 and IPv6."""

NAME: Final = r"[A-Za-z0-9][A-Za-z0-9_-]{0,62}(\.[A-Za-z0-9_-]{1,63})*\.?"
"""A host name or an IPv4 address; other labels cannot be resolved."""

NUMBER_6: Final = r"[0-9A-Fa-f:.]*:[0-9A-Fa-f:.]*(%[^\s/\[\]:%]{1,15})?"
"""What may be an IPv6 address, with the name of an interface (Linux: up to 15 characters)."""

_WITH_PORT = re.compile(rf"(\[{NUMBER_6}\]|{NAME}):(?P<port>\d{{1,5}})")

SocketAddress = tuple[str, int] | tuple[str, int, int, int]
"""Host and port, for IPv6 with flow and scope, as `socket` takes and reports them."""


def as_host(text: str) -> str:
    """A host in its normal form: IPv6 without brackets, as short as it can be.

    Raises:
        ValueError: it is none; the text has the reason and what to write.
    """
    if re.fullmatch(NAME, text):
        return text
    if match := _WITH_PORT.fullmatch(text):
        host = text[: match.start("port") - 1].strip("[]")
        raise ValueError(f"'{text}' has a port; write '{host}', the port follows from base_port")
    bare = text[1:-1] if text.startswith("[") and text.endswith("]") else text
    if not re.fullmatch(NUMBER_6, bare):
        raise ValueError(
            f"'{text:.60}' is no host name and no address; write one like 192.168.1.13, "
            "titan.local, fd00::13 or fe80::13%wlan0"
        )
    try:
        number = ipaddress.IPv6Address(bare)
    except ValueError:
        raise ValueError(f"'{text:.60}' is no IPv6 address; correct it") from None
    if number.ipv4_mapped:
        return str(number.ipv4_mapped)
    if number.is_link_local and not number.scope_id:
        raise ValueError(
            f"'{text}' is valid on one link only; write the interface behind it, "
            f"'{number}%wlan0', by its name on the machines that dial it"
        )
    return str(number)


def is_number(host: str) -> bool:
    """Whether a host is an address, and no name."""
    return ":" in host or _is_ipv4(host)


def _is_ipv4(host: str) -> bool:
    try:
        socket.inet_pton(socket.AF_INET, host)
    except (OSError, ValueError):
        return False
    return True


def family_of(host: str) -> socket.AddressFamily:
    """The family of an address."""
    return socket.AF_INET6 if ":" in host else socket.AF_INET


def socket_address(host: str, port: int, *, mapped: bool = False) -> SocketAddress:
    """What a socket takes for an address and a port.

    Args:
        host: an address.
        port: of TCP or UDP.
        mapped: for an IPv6 socket, which reaches IPv4 by mapped addresses.

    Raises:
        OSError: the interface of a link-local address is not there (yet).
    """
    if ":" not in host:
        return (f"::ffff:{host}", port, 0, 0) if mapped else (host, port)
    bare, _, zone = host.partition("%")
    scope = (int(zone) if zone.isdecimal() else socket.if_nametoindex(zone)) if zone else 0
    return bare, port, 0, scope


def host_of(address: SocketAddress) -> str:
    """The host in what a socket reports: mapped IPv4 as IPv4, link-local IPv6 with interface."""
    host, *_ = address
    host = host.partition("%")[0]
    if ":" not in host:
        return host
    number = ipaddress.IPv6Address(host)
    if number.ipv4_mapped:
        return str(number.ipv4_mapped)
    scope = address[3] if len(address) == 4 else 0
    return f"{number}%{_interface(scope)}" if scope else str(number)


def _interface(index: int) -> str:
    try:
        return socket.if_indextoname(index)
    except OSError:  # it has just gone
        return str(index)


def joined(host: str, port: int) -> str:
    """Host and port in one text, as in URLs."""
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
