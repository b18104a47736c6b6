"""Sets or removes a PX4's signing key by SETUP_SIGNING, and verifies the result."""

import asyncio
import time
from pathlib import Path
from typing import Any

from mocha_link.errors import needs_extra

with needs_extra("a flight", "fly", "air-router"):
    import mavsdk  # noqa: F401 - checked before the rest of it is imported

from mavsdk.plugins.mavlink_direct.mavlink_direct import MavlinkDirectResult

from air_router.errors import NotConfirmedError, NoVehicleError, RefusedError
from air_router.vehicle.px4.limits import KEY_RESPONSE_S, KEY_STORED_S
from air_router.vehicle.px4.mavlink_signing import timestamp_of
from air_router.vehicle.px4.mavlink_values import ARMED, AUTOPILOT, KEY_BYTES, MavCmd, MessageId
from air_router.vehicle.px4.mavsdk_bridge import Received, call, message, subscribe
from air_router.vehicle.px4.px4_connection import Plugins, Px4Connection, SignedVehicleError
from air_router.vehicle.px4.signing_key import SigningKey


async def provide(url: str, system_id: int, key: Path, old: Path | None) -> None:
    """Set the vehicle's signing key.

    Args:
        url: Its link; every receiver on the link learns the key.
        system_id: The vehicle's system id.
        key: The key file.
        old: The file of its current key; None: it has none.

    Raises:
        SigningKeyError: a file has no key, or others can read it.
        NoVehicleError: No vehicle answers, or none with the old key.
        RefusedError: The vehicle is armed, or has a key and `old` was not given.
        NotConfirmedError: It does not follow commands signed with the key.
    """
    secret = SigningKey.read(key).secret
    try:
        await _set_up(url, system_id, secret, timestamp_of(time.time()), old)
    except SignedVehicleError:
        raise RefusedError(
            f"{url}: PX4 has a key already; name its file to replace it: --old FILE"
        ) from None
    try:
        obeys = await _obeys(url, system_id, key)
    except NoVehicleError as error:
        raise NotConfirmedError(
            f"PX4 has not taken the key: it is older than 1.18, or has another one (--old). {error}"
        ) from None
    if not obeys:
        raise NotConfirmedError(f"{url}: PX4 signs with the key, but does not answer; try again")


async def remove(url: str, system_id: int, key: Path) -> None:
    """Remove the vehicle's key, so that it accepts unsigned messages.

    Args:
        url: Its link.
        system_id: The vehicle's system id.
        key: The file of its current key.

    Raises:
        SigningKeyError: the file has no key, or others can read it.
        NoVehicleError: No vehicle with this key answers.
        RefusedError: it is armed.
        NotConfirmedError: It does not follow unsigned commands.
    """
    await _set_up(url, system_id, bytes(KEY_BYTES), 0, key)
    if not await _obeys(url, system_id, None):
        raise NotConfirmedError(f"{url}: PX4 has kept its key; try again")


async def _set_up(
    url: str, system_id: int, secret: bytes, timestamp: int, signed_with: Path | None
) -> None:
    """Send SETUP_SIGNING once; PX4 does not acknowledge it on this link."""
    connection = Px4Connection(url, system_id, key=signed_with)
    try:
        plugins = await connection.open()
        if await _is_armed(plugins, system_id):
            raise RefusedError("the vehicle is armed, and keeps its key; disarm it first")
        fields = {
            "target_system": system_id,
            "target_component": AUTOPILOT,
            "secret_key": list(secret),
            "initial_timestamp": timestamp,
        }
        plugins.direct.send_message(message("SETUP_SIGNING", fields))
        await asyncio.sleep(KEY_STORED_S)
    finally:
        await connection.close()


async def _is_armed(plugins: Plugins, system_id: int) -> bool:
    first: asyncio.Future[dict[str, Any]] = asyncio.get_running_loop().create_future()

    def take(received: Received) -> None:
        if received.sender == (system_id, AUTOPILOT) and not first.done():
            first.set_result(received.fields)

    subscribe(plugins.direct, "HEARTBEAT", take)
    try:
        async with asyncio.timeout(KEY_RESPONSE_S):
            fields = await first
    except TimeoutError:
        raise NoVehicleError("the vehicle has stopped sending HEARTBEAT") from None
    return bool(fields["base_mode"] & ARMED)


async def _obeys(url: str, system_id: int, key: Path | None) -> bool:
    """Whether the vehicle answers a command signed with this key, or unsigned without a key."""
    connection = Px4Connection(url, system_id, key=key)
    try:
        plugins = await connection.open()
        params = {f"param{n}": 0.0 for n in range(1, 8)}
        params["param1"] = float(MessageId.AUTOPILOT_VERSION)
        target = {"target_system": system_id, "target_component": AUTOPILOT}
        fields = {"command": MavCmd.REQUEST_MESSAGE, "confirmation": 0, **target, **params}
        request = message("COMMAND_LONG", fields, system_id)
        result, _ = await call(plugins.direct.send_command_async, request, timeout_s=KEY_RESPONSE_S)
    except (TimeoutError, SignedVehicleError):
        return False
    finally:
        await connection.close()
    return bool(result == MavlinkDirectResult.SUCCESS)
