"""One report of a radio as one line, JSON or plain text; how any program can be a radio.

``{"peer": "io", "rssi_dbm": -61.5}`` or ``io -61.5 dBm``; `docs/radios.md` has all forms.
"""

from __future__ import annotations

import json
import math
import numbers

from mocha_link.errors import RadioError
from mocha_link.links.reading import Reading, Unit

MAX_LINE_BYTES = 2048

KEYS = {"rssi_dbm": Unit.DBM, "snr_db": Unit.SNR_DB, "device": Unit.DEVICE}
WORDS = {"dbm": Unit.DBM, "db": Unit.SNR_DB, "device": Unit.DEVICE}


def parse_report(raw: bytes, source: str = "radio") -> tuple[str, Reading | None]:
    """The peer and how it is heard, from one line; None: not heard.

    `source` is what the reading is from if the line does not say so. Raises RadioError.
    """
    try:
        line = raw.decode().strip()
    except UnicodeDecodeError:
        raise RadioError("a report must be UTF-8 text") from None
    return _from_json(line, source) if line.startswith("{") else _from_words(line, source)


def _from_json(line: str, source: str) -> tuple[str, Reading | None]:
    try:
        report = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise RadioError(f"a report that is no JSON object: {error}") from None
    peer, source = report.get("peer"), report.get("source", source)
    if not isinstance(peer, str):
        raise RadioError('a report must name the "peer" as text')
    if not isinstance(source, str):
        raise RadioError('the "source" of a report must be text')
    found = [key for key in KEYS if key in report]
    if not found:
        raise RadioError(f"a report must have one of the keys {', '.join(KEYS)}")
    for key in found:
        if report[key] is not None:
            return peer, Reading(_number(key, report[key]), KEYS[key], source)
    return peer, None


def _from_words(line: str, source: str) -> tuple[str, Reading | None]:
    words = line.split()
    if len(words) == 2 and words[1].lower() == "none":
        return words[0], None
    if len(words) not in (2, 3):
        raise RadioError("a report in words must be: PEER VALUE [dBm|dB|device], or PEER none")
    unit = WORDS.get(words[2].lower()) if words[2:] else Unit.DBM
    if unit is None:
        raise RadioError(f"'{words[2][:20]}' is no unit; write dBm, dB (for SNR) or device")
    try:
        value = float(words[1])
    except ValueError:
        raise RadioError(f"'{words[1][:20]}' is no number") from None
    return words[0], Reading(value, unit, source)


def _number(key: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        raise RadioError(f"{key} must be a number or null, not {type(value).__name__}")
    try:
        return float(value)
    except OverflowError:
        return math.inf


class Lines:
    """Cuts a stream of bytes into lines; a line that is longer than `limit` is left out.

    `dropped` counts the lines left out.
    """

    def __init__(self, limit: int = MAX_LINE_BYTES) -> None:
        self.dropped = 0
        self._limit = limit
        self._rest = b""  # of a line that has not ended
        self._skipping = False  # within a line that is too long

    def feed(self, data: bytes) -> list[bytes]:
        """The lines that end in `data`, without their ends; blank ones are left out."""
        *lines, rest = (self._rest + data).split(b"\n")
        if lines and self._skipping:
            self._skipping = False
            del lines[0]
        whole = []
        for line in lines:
            if len(line) > self._limit:
                self.dropped += 1
            elif line.strip():
                whole.append(line)
        if len(rest) > self._limit and not self._skipping:
            self._skipping = True
            self.dropped += 1
        self._rest = b"" if self._skipping else rest
        return whole
