"""`air-router signing-key`: makes a key that signs MAVLink, and gives it to a PX4."""

import asyncio
from ipaddress import ip_address

import click

from air_router.cli.arguments import say
from air_router.cli.fly import link_options
from air_router.errors import ExitCode, RefusedError, UsageError
from air_router.vehicle.px4 import SigningKey, provide, remove
from mocha_link.cli import PATH, Options, command, option


@command(
    "Make a signing key or, with --connect, transfer it to PX4 (1.18 or newer), which from then "
    "on accepts only signed messages. The key is sent unencrypted: connect PX4 by USB, "
    "with all radios off.",
    "examples:\n  air-router signing-key uav.key\n"
    "  air-router signing-key uav.key --connect serial:///dev/ttyACM0:57600",
)
@click.argument("file", type=PATH, help="key file; without --connect a new key is written to it")
@link_options(None)
@option("--old", type=PATH, metavar="FILE", help="PX4's current key, which FILE replaces")
@option("--remove", is_flag=True, help="remove the key in FILE from PX4")
@option(
    "--in-the-clear",
    is_flag=True,
    help="send the key over a network, where others may be able to read it",
)
def run(arguments: Options) -> int:
    """Make the key, or give it to the vehicle."""
    url = arguments.connect
    if url is None:
        if arguments.old or arguments.remove:
            raise UsageError("--old and --remove are about a key on a PX4: add --connect URL")
        SigningKey.generate().write(arguments.file)
        say(
            f"{arguments.file}: a new key, for your eyes only. Give it to PX4 over USB: air-router "
            f"signing-key {arguments.file} --connect serial:///dev/ttyACM0:57600"
        )
        return ExitCode.DONE
    if arguments.remove:
        if arguments.old:
            raise UsageError("--remove needs no --old: FILE is the key that PX4 has")
        asyncio.run(remove(url, arguments.sysid, arguments.file))
        say("PX4 has no signing key any more: it obeys all who reach it")
        return ExitCode.DONE
    SigningKey.read(arguments.file)  # before anything is printed of it
    if not arguments.in_the_clear and (host := _network(url)):
        raise RefusedError(
            f"{url}: the key would cross the network to {host} in the clear; connect PX4 by USB, "
            "or add --in-the-clear if only you can receive there"
        )
    say("the key leaves in the clear: every receiver on this link has it")
    asyncio.run(provide(url, arguments.sysid, arguments.file, arguments.old))
    say(
        "PX4 has the key and answers messages signed with it, on all its links. Restart it, "
        "and see with `air-router preflight --signing-key` that it has kept it (its SD card)"
    )
    return ExitCode.DONE


def _network(url: str) -> str:
    """The other machine that a URL leads to; empty: none, or a line."""
    kind, _, end = url.partition("://")
    host = end.rpartition(":")[0]
    if kind.startswith("serial") or host == "localhost":
        return ""
    try:
        return "" if ip_address(host).is_loopback else host
    except ValueError:
        return host or "others"
