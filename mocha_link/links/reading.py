"""How well a radio hears a peer: a value that means nothing without its unit and its source."""

from __future__ import annotations

import enum
import numbers
from dataclasses import dataclass

from mocha_link.errors import RadioError

LIMIT_DBM = 1000
LIMIT_DEVICE = 1e6
MAX_SOURCE_LETTERS = 32


class Unit(enum.Enum):
    """What the value of a reading counts.

    DBM: received power. SNR_DB: signal above noise. DEVICE: a scale of the device's own, more is
    better.
    """

    DBM = "dBm"
    SNR_DB = "dB"
    DEVICE = "device"


@dataclass(frozen=True, slots=True)
class Reading:
    """The strength at which a peer is heard.

    Readings of different units or sources are never compared with each other. The value may be
    given as any real number, such as one of numpy; it is kept as a float. Raises RadioError if it
    cannot be one in that unit, if that is none, or if the source is no short printable text.
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
    """What a radio reported: a reading as it is, a bare number as dBm, nothing as nothing.

    Raises RadioError for anything else.
    """
    if value is None or isinstance(value, Reading):
        return value
    return Reading(value, Unit.DBM, "radio")
