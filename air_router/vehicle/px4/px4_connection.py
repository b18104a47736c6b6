"""Finds the autopilot on a connection, or reports within seconds why there is none."""

import asyncio
import contextlib
import errno
import logging
import os
import re
import socket
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from mocha_link.errors import needs_extra

with needs_extra("a flight", "fly", "air-router"):
    import mavsdk  # noqa: F401 - checked before the rest of it is imported

from mavsdk.autopilot import Autopilot
from mavsdk.component_type import ComponentType
from mavsdk.exceptions import MavsdkError
from mavsdk.mavsdk import Configuration, Mavsdk
from mavsdk.plugins.geofence.geofence import Geofence
from mavsdk.plugins.mavlink_direct.mavlink_direct import MavlinkDirect
from mavsdk.plugins.mission_raw.mission_raw import MissionRaw
from mavsdk.system import System

from air_router.errors import NoVehicleError
from air_router.vehicle.px4.direct_link import DirectLink
from air_router.vehicle.px4.limits import (
    FIND_DATAGRAMS,
    FIND_ELSEWHERE_S,
    FIND_OTHERS_S,
    FIND_POLL_S,
    FIND_S,
    READ_BYTES,
)
from air_router.vehicle.px4.mavlink_signing import MavlinkSigner
from air_router.vehicle.px4.mavlink_values import COMPANION_COMPONENT
from air_router.vehicle.px4.mavsdk_bridge import destroy, route_log
from air_router.vehicle.px4.px4_link import Px4Link, frames

_log = logging.getLogger(__name__)


USUAL_PORTS: Final = (*range(14540, 14550), 14550)
"""PX4's ports: its API links by instance, and the ground station's."""

_EVERYWHERE: Final = ("", "0.0.0.0")  # noqa: S104 - only if the operator gives it

_URL = re.compile(r"(udpin|udpout|tcpin|tcpout|serial|serial_flowcontrol)://(\S+)")


class SignedVehicleError(NoVehicleError):
    """The vehicle accepts only messages signed with its key, and the link has none."""


@dataclass(frozen=True, slots=True)
class Plugins:
    """The MAVSDK plugins that a flight uses; a rehearsal replaces them.

    Attributes:
        direct: Raw messages.
        raw: Transfers of mission, fence and rally points.
        geofence: Clears the fence.
    """

    direct: MavlinkDirect
    raw: MissionRaw
    geofence: Geofence


class Px4Connection:
    """One MAVSDK instance on one connection.

    Like any companion computer it uses the vehicle's system id and component 191, and sends
    heartbeats as an onboard controller.

    Args:
        url: MAVSDK connection URL.
        system_id: The vehicle's.
        key: The file of the signing key; None: the link is not signed.

    Raises:
        NoVehicleError: The URL is invalid.
        SigningKeyError: The file has no key, or others can read it.
    """

    def __init__(self, url: str, system_id: int, *, key: Path | None = None) -> None:
        if _URL.fullmatch(url) is None:
            raise NoVehicleError(
                f"{url}: not a connection; write udpin://127.0.0.1:14540 (PX4's usual), "
                "udpout://HOST:PORT, tcpout://HOST:PORT or serial:///dev/ttyACM0:57600"
            )
        self._url = url
        self.system_id = system_id
        self._mavsdk: Mavsdk | None = None  # None: closed
        self._link: Px4Link | DirectLink | None = None  # our own end; None: MAVSDK's
        self._signer = None if key is None else MavlinkSigner.from_file(key, system_id)
        # opened with the connection
        self._plugins: tuple[()] | tuple[MavlinkDirect, MissionRaw, Geofence] = ()

    async def open(self) -> Plugins:
        """Wait for a PX4.

        Raises:
            NoVehicleError: Nothing answers, something else does, or the port is in use.
        """
        route_log()
        bound = self._bound()
        ours = bound is not None or self._signer is not None
        configuration = Configuration.create_with_component_type(ComponentType.COMPANION_COMPUTER)
        configuration.system_id = self.system_id
        configuration.component_id = COMPANION_COMPONENT
        self._mavsdk = Mavsdk(configuration)
        try:
            self._mavsdk.add_any_connection_with_handle("raw://" if ours else self._url)
        except (MavsdkError, ConnectionError) as error:
            raise self._in_use(error) from None
        receive = self._mavsdk.pass_received_raw_bytes
        if bound is not None:
            self._link = Px4Link(bound, self.system_id, receive, self._signer)
        elif self._signer is not None:
            self._link = await self._direct_link(receive, self._signer)
        if self._link is not None:
            self._mavsdk.subscribe_raw_bytes_to_be_sent(self._link.send)
        system = await self._wanted(self._mavsdk, await self._first_autopilot(self._mavsdk))
        if system.autopilot_type() != Autopilot.PX4:
            raise NoVehicleError(
                f"{self._url}: the autopilot is {system.autopilot_type().name}, not PX4; "
                "only PX4 is flown"
            )
        if self._signer is None and isinstance(self._link, Px4Link) and self._link.signed_unasked:
            raise SignedVehicleError(
                f"{self._url}: PX4 has a signing key, and obeys only what is signed with it: name "
                "its file (--signing-key FILE; docs/security.md)"
            )
        self._plugins = (MavlinkDirect(system), MissionRaw(system), Geofence(system))
        return Plugins(*self._plugins)

    async def _direct_link(
        self, receive: Callable[[bytes], None], signer: MavlinkSigner
    ) -> DirectLink:
        loop = asyncio.get_running_loop()
        try:  # not on the loop: a server may be slow
            return await loop.run_in_executor(None, DirectLink, self._url, receive, signer)
        except ValueError as error:
            raise NoVehicleError(f"{self._url}: {error}") from None
        except OSError as error:
            raise self._in_use(error) from None

    async def _wanted(self, mavsdk: Mavsdk, first: System) -> System:
        """The requested system, if several send here."""
        loop = asyncio.get_running_loop()
        end_s = loop.time() + FIND_OTHERS_S
        if first.get_system_id() == self.system_id:
            return first
        while loop.time() < end_s:
            for other in mavsdk.get_systems():
                if other.get_system_id() == self.system_id and other.has_autopilot():
                    return other
            await asyncio.sleep(FIND_POLL_S)
        found_id = first.get_system_id()
        raise NoVehicleError(
            f"{self._url}: the vehicle has system id {found_id}, not {self.system_id}; "
            f"if it is the right one, give --sysid {found_id}"
        )

    @property
    def posing(self) -> int:
        """Number of messages with the vehicle's system id but without a valid signature."""
        return 0 if self._signer is None else self._signer.posing

    async def close(self) -> None:
        """Close the connection and MAVSDK's threads."""
        mavsdk, self._mavsdk = self._mavsdk, None
        link, self._link = self._link, None
        if link is not None:  # it must not pass anything to MAVSDK anymore
            link.close()
        if self._signer is not None:
            self._signer.close()
        if mavsdk is not None:
            plugins, self._plugins = self._plugins, ()
            await asyncio.get_running_loop().run_in_executor(None, destroy, mavsdk, plugins)

    def _bound(self) -> socket.socket | None:
        """The socket of a `udpin` URL; None for others, which MAVSDK opens."""
        if not self._url.startswith("udpin://"):
            return None
        host, _, port = self._url.removeprefix("udpin://").rpartition(":")
        if ":" in host:
            raise NoVehicleError(
                f"{self._url}: IPv6 is not supported: write an IPv4 address, e.g. "
                f"udpin://127.0.0.1:{port}"
            )
        bound = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            bound.bind((host, int(port)))
        except (ValueError, OverflowError):
            bound.close()
            raise NoVehicleError(f"{self._url}: a port is a number from 1 to 65535") from None
        except OSError as error:
            bound.close()
            if isinstance(error, socket.gaierror) or error.errno == errno.EADDRNOTAVAIL:
                raise NoVehicleError(
                    f"{self._url}: this machine has no address {host}; udpin takes one of its own, "
                    "udpout that of another machine"
                ) from None
            raise self._in_use(error) from None
        if host in _EVERYWHERE:
            _log.warning(
                "%s listens on every network: the first machine that sends as system %d is taken "
                "for the vehicle; write the address that the vehicle sends to",
                self._url,
                self.system_id,
            )
        return bound

    def _in_use(self, error: Exception) -> NoVehicleError:
        why = _serial_fault(self._url) or f"({error}); is another program using it?"
        return NoVehicleError(f"{self._url}: cannot be opened {why}")

    async def _first_autopilot(self, mavsdk: Mavsdk) -> System:
        loop = asyncio.get_running_loop()
        found: asyncio.Future[System | None] = loop.create_future()

        def resolve(system: System | None) -> None:
            if not found.done():
                found.set_result(system)

        handle = mavsdk.first_autopilot_async(
            FIND_S, lambda system: loop.call_soon_threadsafe(resolve, system)
        )
        elsewhere = asyncio.create_task(self._elsewhere())
        try:
            system = await found
            if system is not None:
                return system
            found_elsewhere = await elsewhere
        finally:
            elsewhere.cancel()
            mavsdk.cancel_first_autopilot(handle)
        if self._signer is not None and (why := self._signer.why_none_is_taken):
            raise NoVehicleError(f"{self._url}: {why}")
        others = [other.get_system_id() for other in mavsdk.get_systems()]
        others = [other for other in others if other]
        if others:
            raise NoVehicleError(
                f"{self._url}: MAVLink is received from system {others[0]}, but no autopilot's "
                "HEARTBEAT; perhaps it is a ground station: connect to the vehicle's own link"
            )
        raise NoVehicleError(
            f"{self._url}: nothing received within {FIND_S:.0f} s; is the vehicle on, and does it "
            "send here? PX4 sends to port 14540 + instance of its own machine and keeps to the "
            "first partner that answers it: restart it if another program was there before"
            f"{found_elsewhere}"
        )

    async def _elsewhere(self) -> str:
        """Check whether another of PX4's ports receives MAVLink."""
        if not self._url.startswith("udpin://"):
            return ""
        here = int(self._url.rpartition(":")[2])
        await asyncio.sleep(FIND_S - FIND_ELSEWHERE_S)  # nothing was received so far
        found = await traffic_elsewhere(here, FIND_ELSEWHERE_S)
        return f" ({found})" if found else ""


def _serial_fault(url: str) -> str | None:
    """The fault of a serial URL's device, and the fix; None: no visible fault."""
    if not url.startswith("serial"):
        return None
    device = Path("/" + url.partition("://")[2].lstrip("/").rpartition(":")[0])
    if not device.exists():
        there = ", ".join(sorted(map(str, Path("/dev").glob("tty[AU]*"))))
        found = f"there are {there}" if there else "there is no serial device at all; plug it in"
        return f"({device} is not there): {found}"
    if not device.is_char_device():
        return f"({device} is no serial device): name one such as /dev/ttyACM0"
    if not os.access(device, os.R_OK | os.W_OK):
        return (
            f"(no permission for {device}): `sudo usermod -aG {device.group()} $USER`, then log in "
            "again"
        )
    return None


async def traffic_elsewhere(here: int, limit_s: float) -> str:
    """What other ports of PX4 receive, as the end of a sentence; empty if nothing.

    Nothing is sent: PX4 keeps the first partner that sends to it, and that must not be a port which
    is closed again.

    Args:
        here: The port already in use by us.
        limit_s: How long to check, wall-clock time.
    """
    found, taken = [], []
    with contextlib.ExitStack() as stack:
        listeners = {}
        for port in USUAL_PORTS:
            if port == here:
                continue
            listener = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            listener.setblocking(False)
            try:
                listener.bind(("", port))
            except OSError:
                taken.append(str(port))
            else:
                listeners[port] = listener
        await asyncio.sleep(limit_s)
        for port, listener in listeners.items():
            systems: set[int] = set()
            with contextlib.suppress(OSError):  # nothing is left to read
                for _ in range(FIND_DATAGRAMS):
                    systems |= {system for system, _, _ in frames(listener.recv(READ_BYTES))}
            if systems:
                found.append(f"system {', '.join(map(str, sorted(systems)))} sends to port {port}")
    if taken:
        found.append(f"another program has port {', '.join(taken)}")
    return "; ".join(found)
