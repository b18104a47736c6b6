"""How far, how high and when a zone is kept away from, and the form of that in files.

The names are those of the mission file, which map programs may use as properties too.
"""

import math
import re
from dataclasses import dataclass
from datetime import datetime, time
from enum import StrEnum
from typing import Annotated, Any, Final, Self

from pydantic import BaseModel, Field, PlainValidator, model_validator
from pydantic_core import PydanticCustomError

from air_router.files.findings import DocumentSource, Keys
from geo.airspace import Band, Shape
from geo.validity import DAY_NUMBERS, DAYS, NO_MOMENT, Hours, Period, Validity, moment_of
from mocha_link.sanitize import sanitize


class Reference(StrEnum):
    """What an altitude counts from: the ground at home, the sea, or the ground below."""

    HOME = "home"
    AMSL = "amsl"
    GROUND = "ground"


_WORDS = {Reference.HOME: "home", Reference.AMSL: "the sea", Reference.GROUND: "ground"}


@dataclass(frozen=True, slots=True)
class AltitudeLimit:
    """An altitude, in metres above a reference."""

    metres: float
    reference: Reference = Reference.HOME

    def __str__(self) -> str:
        return f"{self.metres:g} m above {_WORDS[self.reference]}"

    def range_above_home(
        self, home_amsl_m: float | None, terrain_relief_m: float
    ) -> tuple[float, float]:
        """Between which altitudes above home it may lie.

        Raises:
            HomeAltitudeError: it counts from the sea, and home's altitude is not known.
        """
        if self.reference is Reference.AMSL:
            if home_amsl_m is None:
                raise HomeAltitudeError
            return self.metres - home_amsl_m, self.metres - home_amsl_m
        relief_m = terrain_relief_m if self.reference is Reference.GROUND else 0.0
        return self.metres - relief_m, self.metres + relief_m


class HomeAltitudeError(ValueError):
    """An altitude above the sea has no meaning without that of home."""


@dataclass(frozen=True, slots=True)
class Altitudes:
    """From a lower to an upper limit; None: from the ground up, or without end."""

    lower: AltitudeLimit | None = None
    upper: AltitudeLimit | None = None

    def band(self, home_amsl_m: float | None, terrain_relief_m: float) -> Band:
        """The band above home that is sure to hold these altitudes.

        The ground below may lie `terrain_relief_m` higher or lower than the ground at home. Limits
        of different references that leave nothing between them (see `contradicts`) are none: the
        file defines the altitudes for a place that is higher or lower than home.

        Raises:
            HomeAltitudeError: as `AltitudeLimit.range_above_home`.
            ZoneError: the upper limit lies below the lower one, both from the same reference.
        """
        lower, upper = self.lower, self.upper
        if lower and upper and lower.reference is upper.reference:
            Band(lower.metres, upper.metres)  # the terrain must not hide that they are inverted
        if self.contradicts(home_amsl_m, terrain_relief_m):
            return Band()
        return Band(*self._range(home_amsl_m, terrain_relief_m))

    def contradicts(self, home_amsl_m: float | None, terrain_relief_m: float) -> bool:
        """Whether limits that count from different references exclude each other at home.

        Raises:
            HomeAltitudeError: as `AltitudeLimit.range_above_home`.
        """
        if self.lower is None or self.upper is None:
            return False
        lower_m, upper_m = self._range(home_amsl_m, terrain_relief_m)
        return self.lower.reference is not self.upper.reference and lower_m > upper_m

    def _range(self, home_amsl_m: float | None, terrain_relief_m: float) -> tuple[float, float]:
        lower_m, upper_m = -math.inf, math.inf
        if self.lower is not None:
            lower_m, _ = self.lower.range_above_home(home_amsl_m, terrain_relief_m)
        if self.upper is not None:
            _, upper_m = self.upper.range_above_home(home_amsl_m, terrain_relief_m)
        return lower_m, upper_m


@dataclass(frozen=True, slots=True)
class ZoneTerms:
    """How far, how high and when a zone is to be kept away from.

    Attributes:
        clearance_m: What to keep away from it; None: what the mission keeps from all.
        altitudes: Where it applies; None: at every altitude.
        validity: When it applies; None: always.
    """

    clearance_m: float | None = None
    altitudes: Altitudes | None = None
    validity: Validity | None = None


NO_TERMS: Final = ZoneTerms()
"""Kept away from as far as from all zones, at every altitude, always."""


@dataclass(frozen=True, slots=True)
class Area:
    """A fence or a no-fly zone.

    Attributes:
        name: What people call it.
        shape: Where it is, in the local frame.
        keys: Where it stands in its file.
        crosses_fence: It is meant to reach beyond the fence.
        terms: How far, how high and when it is kept away from.
        source: Its file, if that is another one than the mission's.
    """

    name: str
    shape: Shape
    keys: Keys
    crosses_fence: bool = False
    terms: ZoneTerms = NO_TERMS
    source: DocumentSource | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", sanitize(self.name))


# The form in files


def _moment(value: Any) -> datetime:
    try:
        return moment_of(value)
    except ValueError:
        raise PydanticCustomError("not-a-time", NO_MOMENT) from None


def _time_of_day(value: Any) -> time:
    found = re.fullmatch(r"([01]\d|2[0-4]):([0-5]\d)", value) if isinstance(value, str) else None
    if found is None or (found[1] == "24" and found[2] != "00"):
        raise PydanticCustomError(
            "not-a-time", 'not a time of day; write it like "08:00", in UTC and in quotes'
        )
    return time(int(found[1]) % 24, int(found[2]))


def _day(value: Any) -> int:
    if str(value).lower() in DAY_NUMBERS:
        return DAY_NUMBERS[str(value).lower()]
    raise PydanticCustomError("not-a-day", "not a day of the week; write it like monday or mon")


Clearance = Annotated[float, Field(ge=0, le=1_000)]
_Level = Annotated[float, Field(ge=-1_000, le=100_000)]
_Moment = Annotated[datetime, PlainValidator(_moment)]
_TimeOfDay = Annotated[time, PlainValidator(_time_of_day)]
_Day = Annotated[int, PlainValidator(_day)]


class AltitudeForm(BaseModel):
    """Where a zone applies."""

    lower_m: _Level | None = None
    upper_m: _Level | None = None
    reference: Reference = Reference.HOME
    lower_reference: Reference | None = None
    upper_reference: Reference | None = None

    def altitudes(self) -> Altitudes | None:
        """The limits; None: it has none."""
        lower, upper = (
            None if metres is None else AltitudeLimit(metres, reference or self.reference)
            for metres, reference in (
                (self.lower_m, self.lower_reference),
                (self.upper_m, self.upper_reference),
            )
        )
        return Altitudes(lower, upper) if lower or upper else None


class PeriodForm(BaseModel):
    """When a zone applies."""

    begin: Annotated[_Moment | None, Field(alias="from")] = None
    until: _Moment | None = None
    days: Annotated[list[_Day], Field(min_length=1)] | None = None
    between: Annotated[list[_TimeOfDay], Field(min_length=2, max_length=2)] | None = None

    @model_validator(mode="after")
    def _order(self) -> Self:
        if self.begin is not None and self.until is not None and self.until < self.begin:
            raise PydanticCustomError(
                "ends-before-start", "'until' is before 'from'; exchange them"
            )
        return self

    def period(self) -> Period:
        """The period."""
        daily: tuple[Hours, ...] = ()
        if self.days is not None or self.between is not None:
            days = range(len(DAYS)) if self.days is None else self.days
            start, end = self.between or (time(0, 0), time(0, 0))
            daily = (Hours(frozenset(days), start, end),)
        return Period(self.begin, self.until, daily)


class ActiveForm(BaseModel):
    """How far and when a zone is kept away from, beside its other properties in a file."""

    clearance_m: Clearance | None = None
    active: Annotated[list[PeriodForm], Field(min_length=1)] | None = None

    def validity(self) -> Validity | None:
        """When it applies; None: always."""
        if self.active is None:
            return None
        return Validity(tuple(period.period() for period in self.active))


class TermsForm(AltitudeForm, ActiveForm):
    """All terms side by side, as map programs have properties."""

    def terms(self) -> ZoneTerms:
        """The terms."""
        return ZoneTerms(self.clearance_m, self.altitudes(), self.validity())


def terms_data(terms: ZoneTerms, *, altitude_key: str | None = None) -> dict[str, Any]:
    """Terms as plain data that are read back: side by side, or the limits under a key."""
    clearance = {} if terms.clearance_m is None else {"clearance_m": terms.clearance_m}
    limits = _limits_data(terms.altitudes)
    if altitude_key is not None and limits:
        limits = {altitude_key: limits}
    return {**clearance, **limits, **_active_data(terms.validity)}


def _limits_data(altitudes: Altitudes | None) -> dict[str, Any]:
    data: dict[str, Any] = {}
    sides = () if altitudes is None else (("lower", altitudes.lower), ("upper", altitudes.upper))
    for side, limit in sides:
        if limit is not None:
            data[f"{side}_m"] = limit.metres
            if limit.reference is not Reference.HOME:
                data[f"{side}_reference"] = str(limit.reference)
    return data


def _active_data(validity: Validity | None) -> dict[str, Any]:
    entries: list[dict[str, Any]] = []
    for period in () if validity is None else validity.periods:
        bounds: dict[str, Any] = {}
        for name, moment in (("from", period.start), ("until", period.end)):
            if moment is not None:
                bounds[name] = moment.isoformat().replace("+00:00", "Z")
        for hours in period.daily:
            days = sorted(hours.days)
            daily = {"days": [DAYS[day] for day in days]} if len(days) < len(DAYS) else {}
            between = [hours.start.strftime("%H:%M"), hours.end.strftime("%H:%M")]
            entries.append({**bounds, **daily, "between": between})
        if not period.daily:
            entries.append(bounds)
    return {"active": entries} if entries else {}
