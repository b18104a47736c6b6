"""Which numbers are usual in mission and world files, and the unit that another one may be in.

A number can be legal and still not be meant: 0.035 m is 35 m in kilometres, 40 m/s is 40 km/h. What
lies outside of its band is noted with the likely unit; it explains refusals, too.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import log10
from typing import Any, Final, TypeVar

from pydantic import BaseModel

from air_router.files.findings import Keys
from mocha_link.team import Document, DocumentError, Problem

UNUSUAL: Final = "unusual-value"
"""The code of a note on a number outside of its band."""

_NEARLY: Final = 3.0

M = TypeVar("M", bound=BaseModel)


@dataclass(frozen=True, slots=True)
class OtherUnit:
    """A unit in which a number may have been written by mistake.

    Attributes:
        name: As people call it.
        in_ours: The factor to the unit in the key's name.
    """

    name: str
    in_ours: Callable[[float], float]


KM = OtherUnit("km", lambda value: value * 1_000)
FEET = OtherUnit("feet", lambda value: value * 0.3048)
CM = OtherUnit("cm", lambda value: value / 100)
KM_H = OtherUnit("km/h", lambda value: value / 3.6)
MS = OtherUnit("milliseconds", lambda value: value / 1_000)
MINUTES = OtherUnit("minutes", lambda value: value * 60)
HOURS = OtherUnit("hours", lambda value: value * 3_600)
PERCENT = OtherUnit("percent", lambda value: value / 100)
MILLIWATT = OtherUnit("mW", lambda value: 10 * log10(value))
POSITIVE = OtherUnit("dBm without its minus", lambda value: -value)
MHZ = OtherUnit("MHz", lambda value: value / 1_000)
RADIANS = OtherUnit("radians", lambda value: value * 57.29578)
MBIT_S = OtherUnit("Mbit/s", lambda value: value * 125_000)


@dataclass(frozen=True, slots=True)
class Band:
    """The usual values of one number.

    Attributes:
        field: The way to it in its file: `[]` is every entry of a list, `*` every name.
        low, high: The lowest and the highest that is usual.
        unit: Of the key, as messages write it.
        below, above: Units in which a lower, or higher, number is likely to be.
        why: Where the limits come from.
    """

    field: str
    low: float
    high: float
    unit: str
    below: tuple[OtherUnit, ...]
    above: tuple[OtherUnit, ...]
    why: str

    @property
    def keys(self) -> tuple[str, ...]:
        """The steps of the way."""
        return tuple(self.field.replace("[]", ".[]").split("."))

    def holds(self, value: float) -> bool:
        """Whether a number is usual."""
        return self.low <= value <= self.high

    def guess(self, value: float) -> str:
        """The other unit in which it may be, as text; "" if in none that is known."""
        units = self.below if value < self.low else self.above if value > self.high else ()
        meant = [(unit.name, unit.in_ours(value)) for unit in units if value]
        likely = [each for each in meant if self.holds(each[1])]
        likely = likely or [each for each in meant if self._nearly_holds(each[1])][:1]
        if not likely:
            return ""
        (name, ours), *others = ((name, float(f"{ours:.3g}")) for name, ours in likely)
        besides = "".join(f" (in {name}: {ours:g})" for name, ours in others)
        return f"given in {name}? then write {ours:g}{besides}"

    def _nearly_holds(self, value: float) -> bool:
        """Whether a number is not far from usual: 1200 feet are high, and feet all the same."""
        return min(self.low, self.low / _NEARLY) <= value <= max(self.high, self.high * _NEARLY)

    def note_text(self, name: str, value: float) -> str:
        """A note on a number outside of the band."""
        usual = f"usual is {self.low:g} to {self.high:g}{self.unit} ({self.why})"
        advice = self.guess(value) or "correct it if it is not meant"
        return f"{name} is {value:g}{self.unit}; {usual}; {advice}"


_LAW = "above home, not above the sea; most laws allow 120 m"
_STATE = "time to fly somewhere, far less than a battery lasts"
_BATTERY = "a multicopter flies for minutes to a few hours"
_KEPT = "GPS alone is off by metres"

MISSION: Final = (
    Band("altitude_m", 2, 150, " m", (KM,), (FEET,), _LAW),
    Band("altitudes_m[]", 2, 150, " m", (KM,), (FEET,), _LAW),
    Band("waypoints[].altitude_m", 2, 150, " m", (KM,), (FEET,), _LAW),
    Band("uavs.*.altitude_m", 2, 150, " m", (KM,), (FEET,), _LAW),
    Band("home.altitude_amsl_m", -430, 5_500, " m", (), (FEET,), "where towns are"),
    Band(
        "uavs.*.home.altitude_amsl_m",
        -430,
        5_500,
        " m",
        (),
        (FEET,),
        "where towns are",
    ),
    Band("speed_m_s", 1, 15, " m/s", (), (KM_H,), "PX4's MPC_XY_VEL_MAX is 12 m/s by default"),
    Band("timers.init_s", 10, 3_600, " s", (MINUTES, HOURS), (MS,), _STATE),
    Band("timers.explore_s", 10, 3_600, " s", (MINUTES, HOURS), (MS,), _STATE),
    Band("timers.search_s", 3, 1_800, " s", (MINUTES, HOURS), (MS,), _STATE),
    Band("timers.communicate_s", 3, 1_800, " s", (MINUTES, HOURS), (MS,), _STATE),
    Band("timers.hold_s", 1, 1_800, " s", (MINUTES, HOURS), (MS,), _STATE),
    Band("timers.revisit_s", 1, 3_600, " s", (MINUTES, HOURS), (MS,), _STATE),
    Band("planner.clearance_m", 1, 100, " m", (KM,), (CM, FEET), _KEPT),
    Band("planner.tracking_margin_m", 0.3, 20, " m", (KM,), (CM, FEET), _KEPT),
    Band("planner.wind_m_s", 0, 15, " m/s", (), (KM_H,), "small multicopters fly to 12 m/s"),
    Band("planner.position_accuracy_m", 0.3, 5, " m", (), (CM, FEET), "GPS has 0.5 to 3 m"),
    Band("planner.max_edge_m", 10, 3_000, " m", (KM,), (CM, FEET), "a leg between waypoints"),
    Band("planner.acceptance_radius_m", 0.5, 10, " m", (), (FEET,), "PX4 has 2 m for multicopters"),
    Band("planner.vertical_margin_m", 2, 50, " m", (), (FEET,), "barometer and GPS differ by less"),
    Band("planner.terrain_relief_m", 0, 300, " m", (), (FEET,), "it widens every zone's limits"),
    Band("planner.vertical_separation_m", 4, 100, " m", (), (FEET,), "of two layers"),
    Band("planner.home_separation_m", 4, 500, " m", (), (FEET,), "of two take-off places"),
    Band("fence.circle.radius_m", 10, 20_000, " m", (KM,), (CM, FEET), "a yard to a valley"),
    Band("fences[].circle.radius_m", 10, 20_000, " m", (KM,), (CM, FEET), "as of 'fence'"),
    Band(
        "no_fly_zones[].circle.radius_m",
        1,
        60_000,
        " m",
        (KM,),
        (CM, FEET),
        "a mast to an airport zone",
    ),
    Band("no_fly_zones[].clearance_m", 1, 500, " m", (KM,), (CM, FEET), _KEPT),
    Band("no_fly_zones[].altitude.lower_m", -500, 6_000, " m", (), (FEET,), "up to FL 195"),
    Band("no_fly_zones[].altitude.upper_m", 1, 20_000, " m", (KM,), (FEET,), "up to FL 660"),
    Band("duration_s", 60, 14_400, " s", (MINUTES, HOURS), (MS,), _BATTERY),
    Band("endurance_s", 180, 14_400, " s", (MINUTES, HOURS), (MS,), _BATTERY),
    Band("battery_reserve", 0.1, 0.6, "", (), (PERCENT,), "a share: 0.25 is 25 %"),
)
"""The numbers of a mission file, and of the options that stand for them."""

WORLD: Final = (
    Band("radio.tx_power_dbm", -10, 40, " dBm", (), (MILLIWATT,), "0.1 mW to 10 W"),
    Band("radio.reference_loss_db", 20, 80, " dB", (), (), "40 dB at 2.4 GHz"),
    Band("radio.path_loss_exponent", 1.6, 6, "", (), (), "2 in free space, 3 to 4 in towns"),
    Band("radio.ground_to_ground_loss_db", 0, 40, " dB", (), (), "low antennas"),
    Band("radio.shadowing_db", 0, 12, " dB", (), (), "a standard deviation"),
    Band("radio.shadowing_interval_s", 0.5, 600, " s", (), (MS,), "a robot drives on meanwhile"),
    Band("radio.carrier_ghz", 0.5, 70, " GHz", (), (MHZ,), "of radios in use"),
    Band("radio.sensitivity_dbm", -130, -40, " dBm", (), (POSITIVE,), "LoRa to a poor Wi-Fi"),
    Band("radio.reading_interval_s", 0.02, 60, " s", (), (MS,), "how often radios report"),
    Band("radio.rate_bytes_s", 50, 1e6, " B/s", (MBIT_S,), (), "LoRa to a busy Wi-Fi"),
    Band("camera.fov_across_deg", 10, 130, "°", (RADIANS,), (), "a lens in use"),
    Band("camera.fov_along_deg", 10, 130, "°", (RADIANS,), (), "a lens in use"),
    Band("camera.min_height_m", 0, 100, " m", (), (CM, FEET), "below most cruise altitudes"),
    Band("camera.interval_s", 0.03, 60, " s", (), (MS,), "time between pictures"),
    Band("terrain.margin_m", 0, 2_000, " m", (), (CM, FEET), "the ground beyond the fence"),
    Band("terrain.roads[].width_m", 1, 60, " m", (KM,), (CM, FEET), "a path to a motorway"),
    Band("robots.*.speed_m_s", 0.05, 1.5, " m/s", (), (KM_H,), "a ground robot at walking pace"),
    Band("robots.*.start_m", 0, 20_000, " m", (), (CM, FEET), "along the patrol"),
    Band("explore.speed_m_s", 0.05, 3, " m/s", (), (KM_H,), "a ground robot at walking pace"),
    Band("explore.progress", 0.02, 1, "", (), (PERCENT,), "a share: 0.2 is 20 %"),
    Band("explore.sight_m", 1, 100, " m", (KM,), (CM, FEET), "what a robot sees from the ground"),
    Band("explore.recognition_m", 1, 100, " m", (KM,), (CM, FEET), "as of 'sight_m'"),
    Band("explore.patience_s_m", 0.5, 120, " s/m", (), (MS,), "slower than the robot drives"),
    Band("explore.recall", 0.05, 1, "", (), (PERCENT,), "a share: 0.9 is 90 %"),
    Band("explore.located", 0.05, 1, "", (), (PERCENT,), "a share: 0.9 is 90 %"),
    Band("explore.localisation_m", 0, 50, " m", (), (CM, FEET), "in a map from above"),
    Band("explore.stuck", 0, 0.9, "", (), (PERCENT,), "a share: 0.1 is 10 %"),
    Band("explore.thinking_s", 0.1, 300, " s", (), (MS,), "between two searches for a goal"),
)
"""The numbers of a world file."""

OPTIONS: Final = (Band("every", 1, 1_000, " m", (KM,), (CM, FEET), "between waypoints of a row"),)
"""Numbers that only options set."""


def notes(document: Document, bands: Iterable[Band]) -> Iterator[Problem]:
    """Notes on the numbers of a file that are not usual; one for each kind and side of its band."""
    home_amsl_m = next((v for _, v in _values(document.data, ("home", "altitude_amsl_m"))), None)
    for each in bands:
        band = each
        if home_amsl_m is not None and each.why == _LAW:
            band = replace(each, above=(_above_sea(home_amsl_m), *each.above))
        values = list(_values(document.data, band.keys))
        for outside in (
            [each for each in values if each[1] < band.low],
            [each for each in values if each[1] > band.high],
        ):
            if outside:
                keys, value = outside[0]
                more = f" (and {len(outside) - 1} more)" if len(outside) > 1 else ""
                text = band.note_text(f"'{_name(keys)}'{more}", value)
                yield document.problem(keys, text, UNUSUAL)


def _above_sea(home_amsl_m: float) -> OtherUnit:
    """Metres above the sea where home is this high above it."""
    return OtherUnit("metres above the sea", lambda value: value - home_amsl_m)


def explained(error: DocumentError, data: Any, bands: Sequence[Band]) -> DocumentError:
    """Refused numbers with the unit that they may be in."""
    return DocumentError(_explained(problem, data, bands) for problem in error.problems)


def parse_world(document: Document, model: type[M]) -> M:
    """The document as a model whose numbers are those of `WORLD`.

    Raises:
        DocumentError: as `Document.parse`; refused numbers with the unit that they may be in.
    """
    try:
        return document.parse(model)
    except DocumentError as error:
        raise explained(error, document.data, WORLD) from None


def option_notes(given: Iterable[tuple[str, float | None, str]]) -> Iterator[str]:
    """Notes on options: each with its value (None: it is not given) and the field that it sets."""
    by_field = {band.field: band for band in (*MISSION, *OPTIONS)}
    for option, value, field in given:
        if value is not None and not by_field[field].holds(value):
            yield f"note: {by_field[field].note_text(option, value)}"


def _explained(problem: Problem, data: Any, bands: Sequence[Band]) -> Problem:
    if problem.code != "out-of-range":
        return problem
    for band in bands:
        value = next((v for keys, v in _values(data, band.keys) if keys == problem.keys), None)
        if value is not None and (guess := band.guess(value)):
            return replace(problem, message=f"{problem.message.rpartition(';')[0]}; {guess}")
    return problem


def _values(data: Any, steps: Sequence[str], keys: Keys = ()) -> Iterator[tuple[Keys, float]]:
    """The numbers at a way, each with its keys."""
    if not steps:
        if isinstance(data, int | float) and not isinstance(data, bool):
            yield keys, float(data)
    elif steps[0] == "[]":
        for index, entry in enumerate(data if isinstance(data, list) else ()):
            yield from _values(entry, steps[1:], (*keys, index))
    elif isinstance(data, dict):
        for key in data if steps[0] == "*" else (steps[0],):
            if key in data:
                yield from _values(data[key], steps[1:], (*keys, key))


def _name(keys: Keys) -> str:
    path = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in keys)
    return path.removeprefix(".")
