"""Signal strength of peers: one adapter per radio, each an entry point of `mocha_link.radios`."""

from collections.abc import Mapping
from importlib.metadata import EntryPoint

from mocha_link.errors import MochaLinkError, RadioError
from mocha_link.radios.radio import ManualRadio, Radio, Report
from mocha_link.radios.reports import UdpRadio
from mocha_link.team import RADIO_GROUP, RadioUrl, Team, radios_of_others

__all__ = ["ManualRadio", "Radio", "Report", "UdpRadio", "open_radio"]

OURS: Mapping[str, str] = {
    "babel": "mocha_link.radios.babel:open_babel",
    "mavlink": "mocha_link.radios.reports:open_mavlink",
    "rajant": "mocha_link.radios.rajant:open_rajant",
    "stdin": "mocha_link.radios.reports:open_stdin",
    "tcp": "mocha_link.radios.reports:open_tcp",
    "udp": "mocha_link.radios.reports:open_udp",
    "wifi": "mocha_link.radios.wifi:open_wifi",
}
"""Our entry points by scheme, as pyproject.toml registers them; they are there without it, too."""


def open_radio(url: str, team: Team, robot_name: str) -> Radio:
    """The radio of a robot, not yet started. `url` is what the team file has as its `radio`.

    Raises:
        RadioError: the URL is invalid, the team file does not identify the peers for it, or the
            package of the radio is broken.
        UnknownRobotError: the team has no such robot.
    """
    robot = team.robot(robot_name)
    parsed = RadioUrl.parse(url)
    ours = OURS.get(parsed.scheme)
    if ours:
        radio: Radio = EntryPoint(parsed.scheme, ours, RADIO_GROUP).load()(parsed, team, robot)
        return radio
    entry = radios_of_others(OURS)[parsed.scheme]
    try:
        radio = entry.load()(parsed, team, robot)
    except MochaLinkError:
        raise
    except Exception as error:
        raise _broken(entry, f"{type(error).__name__}: {error}") from error
    for method in ("start", "close"):
        if not callable(getattr(radio, method, None)):
            raise _broken(entry, f"{type(radio).__name__} has no method {method}")
    return radio


def _broken(entry: EntryPoint, why: str) -> RadioError:
    package = entry.dist.name if entry.dist else "?"
    return RadioError(
        f"the radio '{entry.name}:' of the package '{package}' is broken: {why:.200}; correct or "
        "uninstall that package"
    )
