"""Radio reports: what counts as one."""

from __future__ import annotations

import contextlib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mocha_link.radios import ManualRadio, RadioError, UdpRadio, parse_report


def test_reports():
    assert parse_report(b'{"peer": "io", "rssi_dbm": -61.5}') == ("io", -61.5)
    assert parse_report(b'{"peer": "io", "rssi_dbm": -61, "snr_db": 9}') == ("io", -61.0)
    assert parse_report(b'{"peer": "io", "rssi_dbm": null}') == ("io", None)


@pytest.mark.parametrize(
    "raw",
    [
        b"",
        b"[]",
        b'"io"',
        b'{"peer": "io"}',
        b'{"peer": 3, "rssi_dbm": -50}',
        b'{"peer": "io", "rssi_dbm": "-50"}',
        b'{"peer": "io", "rssi_dbm": true}',
        b'{"peer": "io", "rssi_dbm": NaN}',
        b'{"peer": "io", "rssi_dbm": 1e300}',
        b'{"peer": "io", "rssi_dbm": ' + b"9" * 400 + b"}",
        b"[" * 2000,
    ],
)
def test_what_is_no_report(raw):
    with pytest.raises(RadioError):
        parse_report(raw)


@settings(deadline=None, max_examples=100)
@given(st.binary(max_size=80))
def test_any_datagram_is_a_report_or_a_radio_error(raw):
    with contextlib.suppress(RadioError):
        parse_report(raw)


@pytest.mark.parametrize("endpoint", ["", "udp://", "udp://:5", "tcp://a:5", "udp://a:99999"])
def test_endpoints_that_are_none(endpoint):
    with pytest.raises(RadioError, match="write udp://host:port"):
        UdpRadio(endpoint)


def test_a_radio_that_was_never_started():
    radio = UdpRadio("udp://127.0.0.1:5")
    assert radio.port == 5
    radio.close()


def test_a_manual_radio_says_what_it_is_told():
    radio, heard = ManualRadio(), []
    radio.report("io", -50)
    radio.start(lambda *report: heard.append(report))
    radio.report("io", -51)
    radio.close()
    radio.report("io", -52)
    assert heard == [("io", -51)]
