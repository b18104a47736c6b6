"""Where the node learns how well its radio hears the others: one port, one adapter per radio."""

from mocha_link.errors import RadioError
from mocha_link.links.reading import Reading, Unit, as_dbm, as_reading
from mocha_link.radios.factory import open_radio
from mocha_link.radios.mavlink import MavlinkRadio
from mocha_link.radios.port import ManualRadio, Radio, Report
from mocha_link.radios.rajant import RajantRadio
from mocha_link.radios.reports import parse_report
from mocha_link.radios.streams import StdinRadio, TcpRadio, UdpRadio
from mocha_link.radios.wifi import WifiRadio
from mocha_link.team.url import RadioUrl, RadioUrlError

__all__ = [
    "ManualRadio",
    "MavlinkRadio",
    "Radio",
    "RadioError",
    "RadioUrl",
    "RadioUrlError",
    "RajantRadio",
    "Reading",
    "Report",
    "StdinRadio",
    "TcpRadio",
    "UdpRadio",
    "Unit",
    "WifiRadio",
    "as_dbm",
    "as_reading",
    "open_radio",
    "parse_report",
]
