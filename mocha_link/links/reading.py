"""How strongly a radio receives a peer: a value with its unit and its source."""

from __future__ import annotations

import enum
import numbers
from dataclasses import dataclass

from mocha_link.errors import RadioError

LIMIT_DBM = 1000
LIMIT_DEVICE = 1e6
MAX_SOURCE_LETTERS = 32


class Unit(enum.Enum):
    """The unit of a reading.

    DBM: received power. SNR_DB: signal above noise. DEVICE: a scale of the device; more is better.
    """

    DBM = "dBm"
    SNR_DB = "dB"
    DEVICE = "device"


@dataclass(frozen=True, slots=True)
class Reading:
    """The signal strength of a peer.

    A node never compares readings of different units or sources. The value may be any real number,
    such as one of numpy; the reading stores a float.

    Attributes:
        value: the strength, in `unit`.
        unit: the unit of the value.
        source: the radio or program that reported it, 1 to 32 printable characters.

    Raises:
        RadioError: the value is not a number or out of range (1000 dBm, 1000 dB, 1e6 of a device),
            the unit is not a `Unit`, or the source is not a short printable text.
    """

    value: float  # in the unit's own measure
    unit: Unit
    source: str  # what reports it: a radio, a program

    def __post_init__(self) -> None:
        if isinstance(self.value, bool) or not isinstance(self.value, numbers.Real):
            raise RadioError(f"a reading must be a number, not {type(self.value).__name__}")
        if not isinstance(self.unit, Unit):
            raise RadioError(f"the unit of a reading must be a Unit, not {self.unit!r:.40}")
        limit = LIMIT_DEVICE if self.unit is Unit.DEVICE else LIMIT_DBM
        if not -limit <= self.value <= limit:  # also NaN
            raise RadioError(f"a reading in {self.unit.value} must be within ±{limit:g}")
        object.__setattr__(self, "value", float(self.value))  # the one place where it is set
        source = self.source
        if not (source and len(source) <= MAX_SOURCE_LETTERS and source.isprintable()):
            raise RadioError(f"a source must be 1 to {MAX_SOURCE_LETTERS} printable letters")

    @property
    def text(self) -> str:
        """The value, rounded, and its unit."""
        return f"{self.value:.0f} {self.unit.value}"

    def __str__(self) -> str:
        return f"{self.value:g} {self.unit.value} ({self.source})"


def as_reading(value: Reading | float | None) -> Reading | None:
    """Convert the report of a radio.

    Args:
        value: a reading, an RSSI in dBm, or None.

    Returns:
        The reading; a bare number becomes a reading in dBm; None stays None.

    Raises:
        RadioError: the value is neither.
    """
    if value is None or isinstance(value, Reading):
        return value
    return Reading(value, Unit.DBM, "radio")
