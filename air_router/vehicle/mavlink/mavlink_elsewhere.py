"""Where else MAVLink arrives on this computer, when nothing does where it was expected.

It only listens: a PX4 keeps to the first partner that talks to it, and that must not be us on a
port which is then given up again.
"""

import asyncio
import contextlib
import socket
from collections.abc import Iterable
from typing import Final

USUAL_PORTS: Final = (*range(14540, 14550), 14550)
"""PX4's: its API links by instance, and the ground station's."""

_MAGIC_1, _MAGIC_2 = 0xFE, 0xFD
_SYSTEM_AT: Final = {_MAGIC_1: 3, _MAGIC_2: 5}


def system_of(datagram: bytes) -> int | None:
    """The system id of the first MAVLink frame in a datagram; None if it is something else."""
    if not datagram or datagram[0] not in _SYSTEM_AT or len(datagram) <= _SYSTEM_AT[datagram[0]]:
        return None
    return datagram[_SYSTEM_AT[datagram[0]]]


class _Receiver(asyncio.DatagramProtocol):
    def __init__(self) -> None:
        self.systems: set[int] = set()  # autopilots heard

    def datagram_received(self, data: bytes, _address: object) -> None:
        system = system_of(data)
        if system is not None:
            self.systems.add(system)


async def listen(
    ports: Iterable[int], limit_s: float
) -> tuple[dict[int, tuple[int, ...]], tuple[int, ...]]:
    """Listen on UDP ports for a wall-clock time.

    Returns:
        The systems heard by port, and the ports that other programs have.
    """
    loop = asyncio.get_running_loop()
    ears: dict[int, _Receiver] = {}
    taken = []
    async with contextlib.AsyncExitStack() as stack:
        for port in ports:
            bound = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            try:
                bound.bind(("", port))
            except OSError:
                bound.close()
                taken.append(port)
                continue
            transport, ear = await loop.create_datagram_endpoint(_Receiver, sock=bound)
            stack.callback(transport.close)
            ears[port] = ear
        await asyncio.sleep(limit_s)
    heard = {port: tuple(sorted(ear.systems)) for port, ear in ears.items() if ear.systems}
    return heard, tuple(taken)


def advice(heard: dict[int, tuple[int, ...]], taken: tuple[int, ...]) -> str:
    """What was found elsewhere, as the end of a sentence; empty if nothing was."""
    parts = [
        f"system {', '.join(map(str, systems))} sends to port {port}"
        for port, systems in sorted(heard.items())
    ]
    if taken:
        parts.append(f"another program has port {', '.join(map(str, taken))}")
    return "; ".join(parts)
