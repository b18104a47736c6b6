"""What one simulated run is made of: the team, the channel, the protocol, and every reading.

A reading is a choice where the paper's text leaves one. Each has one default for all rows; how the
defaults came about: docs/evidence/experiments.md. An experiment that takes another one states it.
"""

from __future__ import annotations

import random
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from air_router.files import DEFAULT_SEEK_POLICY, known_policy
from sitl.world.explorers import ExplorerSettings, PlacedBy, Positive

ChannelKind = Literal["paper", "path_loss"]
"""`paper`: one transmission at a time anywhere, random latencies per stage, contact by radius.
`path_loss`: received power, a rate that follows from it, and spatial reuse."""

ProtocolKind = Literal["original", "ours"]
"""`original`: one request at a time (GHEAD, a GDATA per message, DENDT), as MOCHA does.
`ours`: the sync between two nodes of `mocha_link`."""

AtLeastZero = Annotated[float, Field(ge=0, le=1e9)]
Blocks = Annotated[int, Field(ge=1, le=20)]
Level = Annotated[float, Field(ge=-300, le=300)]
"""What a file of an experiment may write where these stand."""

PulledBy = Literal["contact", "node"]
"""`contact`: a contact has every robot pull once, or as often as the channel's `pull_every_s`.
`node`: the trigger of `mocha_link` pulls, every 2 s while a contact lasts; our protocol follows its
last pull, and what a peer stores in between is pushed."""

ORACLES: Final = ("oracle", "oracle_tour")
"""Yardsticks: a `rendezvous`, or a `tour`, that receives every `ORACLE_S` where all ground robots
are, and knows how much each is worth."""

OFF_BOARD: Final = (
    *("orienteering", "milp", *ORACLES, "nearest", "three_in_turn", "ferry"),
    *("tour_one_robot", "tour_no_ages", "tour_no_paths"),
)
"""Policies that no vehicle can fly with. `orienteering`: `freshest` with a look ahead. `milp`: the
best `tour` over meeting points. `nearest`: of the robots not sought in this round, the nearest.
`three_in_turn`: the next three robots of the turn, nearest first. `ferry`: a `tour` over beliefs of
positions. The others: a `tour` without one of its parts."""


def _policy(name: str) -> str:
    """The name of a policy that flies (docs/seeking.md), or of one that does not."""
    return name if name in OFF_BOARD else known_policy(name)


PolicyKind = Annotated[str, AfterValidator(_policy)]

MessageWait = Literal["wait", "data_wait", "header_wait", "delay", "data_delay", "header_delay"]
"""Which columns are the paper's message wait: of all messages, robots' data, or header requests;
until a transmission begins (`wait`), or until it has arrived (`delay`)."""


class _Model(BaseModel):
    """Settings that a file may have; all of them may be left out, and none changes in a run."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class MissionTimers(_Model):
    """How long the states of a UAV's mission last; the authors' of their simulated experiments.

    Attributes:
        init_s: INIT, before any robot is sought.
        explore_s: EXPL, between two searches.
        search_s: SEARCH, from the arrival where a robot should be.
        communicate_s: COMM, at the most.
    """

    init_s: Positive = 150.0
    explore_s: Positive = 60.0
    search_s: Positive = 5.0
    communicate_s: Positive = 30.0


class PaperModel(_Model):
    """The paper's transmission model, as it is read (docs/evidence/experiment-engine.md).

    Each stage of an exchange takes an exponentially distributed time; the rates are those that the
    authors fitted to their field data.

    Attributes:
        header_rate_1_s: Rate of the header request (the paper's lambda_h).
        data_rate_1_s: Rate of each piece of data (lambda_t).
        end_rate_1_s: Rate of the end of communication (lambda_e).
        cut: What becomes of an exchange whose robots lose contact. `timeout`: it goes on if contact
            comes back within `timeout_s`, else it ends, and the next contact begins a new one.
            `drop`: it ends at once. `hold`: it waits for the next contact, however long.
        timeout_s: The node's time-out in the paper's experiments.
        order: Who gets the channel. `fixed`: the waiting exchange that comes first in the order of
            the robots' names (who pulls, then from whom). `arrival`: who has waited longest.
            `random`: any of them.
        pull_every_s: Pull again after so long in a contact that lasts; None: once per contact,
            when it begins.
        piece: What a piece of data is in our protocol, which packs several messages into a frame.
            `message`: every message takes its own time, as in the original. `frame`: a frame does.
    """

    header_rate_1_s: Positive = 2.67
    data_rate_1_s: Positive = 7.63
    end_rate_1_s: Positive = 0.51
    cut: Literal["timeout", "hold", "drop"] = "timeout"
    timeout_s: Positive = 5.0
    order: Literal["fixed", "arrival", "random"] = "fixed"
    pull_every_s: Positive | None = None
    piece: Literal["message", "frame"] = "message"


class PathLossModel(_Model):
    """Log-distance path loss with shadowing and buildings: `sitl.world.radio`.

    Two transmissions exclude one another only if one of the four robots receives one of the other
    two; so far apart they share the channel in space.

    Attributes:
        air: The link between a UAV above the roofs and a robot below. `log_distance`: as between
            robots on the ground. `umi_av`, `uma_av`: as 3GPP has it, by `sitl.world.air_to_ground`.
            `obstacles`: by the town's own buildings and trees, `sitl.world.obstacles`. `aerpaw`: as
            it was measured, `sitl.world.measured_link`. With all but the first, fading is by place
            and not by time.
        carrier_ghz: Frequency of such links.
        shadowing_db: Standard deviation of slow fading; of such links the tables have it.
        building_loss_db_m: Extra loss per metre of building on the line between two robots on the
            ground; a vehicle above the roofs looks over them, but with `obstacles`.
        most_building_db: No line loses more than this to buildings: waves go around.
        trigger_dbm: At this power a contact begins.
        hysteresis_db: So much weaker it ends.
        carrier_dbm: At this power a transmission of others keeps one from sending.
        rates: `linear`: by the two below. `802.11n`: half of the rate of a 20 MHz channel with one
            stream, by the least power that the standard requires at each rate.
        rate_bytes_s: What a link at 30 dB above `trigger_dbm` carries.
        least_rate_bytes_s: What a link at `trigger_dbm` carries; between both it is linear in dB.
        round_trip_s: Time of a round trip without any data.
        pull_every_s: Pull again after so long in a contact; None: once per contact.
    """

    air: Literal["log_distance", "umi_av", "uma_av", "obstacles", "aerpaw"] = "log_distance"
    carrier_ghz: Annotated[float, Field(ge=0.5, le=100)] = 2.4
    shadowing_db: AtLeastZero = 4.0
    building_loss_db_m: AtLeastZero = 1.0
    most_building_db: AtLeastZero = 30.0
    trigger_dbm: Level = -75.0
    hysteresis_db: AtLeastZero = 3.0
    carrier_dbm: Level = -85.0
    rates: Literal["linear", "802.11n"] = "linear"
    rate_bytes_s: Positive = 1.0e6
    least_rate_bytes_s: Positive = 3.0e4
    round_trip_s: Positive = 0.01
    pull_every_s: Positive | None = 10.0


class RunSettings(_Model):
    """One run but for its seed.

    Attributes:
        town: The file of the town: roads, buildings, goals (`sitl.world.towns.town`). In an
            experiment's file also the name of a town that comes with the program; so `mission`.
        world: What is flown in: the `town`; or the `mission`'s own world, with its patrols, radios,
            timers and battery, where of all else only the policy counts. `processes`: that world
            by `air-router sim`.
        mission: The mission that the UAVs fly over it: waypoints, fence, no-fly zones. Its timers,
            speed and altitude are replaced by those below. None: lanes over the whole town.
        uavs: How many UAVs. The first explores and searches, the others only search.
        ugvs: How many ground robots.
        explorer: How ground robots drive and decide.
        goals: Where the vehicles that are to be found stand: as the `town` has them, or as many
            beside its roads as the `seed` has it.
        starts: Where ground robots start: at the first places of the `town`, or at those that the
            `seed` draws.
        base_station: Whether there is a base station at home. The UAVs seek it like a robot.
        channel: Which model of the radio.
        radius_m: Contact is nearer than this (`paper`). Horizontal distance: the paper's UAV flies
            at 60 m and meets robots within 5 to 30 m, so its height cannot count.
        paper, path_loss: The models' numbers; the one that `channel` names counts.
        protocol: Of the nodes.
        pulls: Who begins a pull.
        duration_s: Simulated time of the run.
        policy: Whom the UAVs seek.
        blocks: A new town of so many blocks from west to east and from south to north, made by the
            seed, with lanes over it, takes the place of `town` and `mission`.
        vehicles_per_block: Vehicles in such a town.
        linked: Every robot is always in contact with the first UAV, and exchanges take no time:
            what perfect communication would bring, which no policy can choose.
        values: How much each ground robot's service counts in the mean of all, over again from the
            first; empty: all alike. Of the policies only `oracle` and `orienteering` know
            them.
        passive: The UAVs never seek a robot: they go round the waypoints, and talk to whom they
            pass.
        timers: Of the UAVs' mission.
        uav_speed_m_s, uav_altitude_m, uav_acceleration_m_s2: How UAVs fly.
        airframe: `plain`: straight legs with that acceleration. `px4`: guidance, airframe and drag
            of the simulated autopilot, which has an acceleration of its own.
        uav_climb_m_s: How fast they take off (PX4's default), straight up from home.
        battery: Minutes that a full battery flies, as the simulated vehicle's drains; at the
            mission's `battery_reserve` a UAV comes home and lands. `none`: it never does.
        map_interval_s: A UAV publishes its map so often.
        message_wait: What the paper's waits are compared with, in a calibration.
        telemetry_s: A UAV's controller receives it so often.
        link_scores: Models of links are fitted during the run and judged by the links that follow.
    """

    town: Path = Path("urban")
    world: Literal["town", "mission", "processes", "px4"] = "town"
    mission: Path | None = None
    blocks: tuple[Blocks, Blocks] | None = None
    vehicles_per_block: Annotated[float, Field(gt=0, le=3)] = 2.0
    uavs: Annotated[int, Field(ge=0, le=50)] = 1
    ugvs: Annotated[int, Field(ge=0, le=1000)] = 3
    explorer: ExplorerSettings = ExplorerSettings()
    goals: PlacedBy = "town"
    starts: PlacedBy = "town"
    base_station: bool = True
    channel: ChannelKind = "paper"
    radius_m: Positive = 30.0
    paper: PaperModel = PaperModel()
    path_loss: PathLossModel = PathLossModel()
    protocol: ProtocolKind = "original"
    pulls: PulledBy = "contact"
    duration_s: Positive = 1800.0
    policy: PolicyKind = DEFAULT_SEEK_POLICY
    linked: bool = False
    values: tuple[Positive, ...] = ()
    passive: bool = False
    timers: MissionTimers = MissionTimers()
    uav_speed_m_s: Positive = 5.0
    uav_altitude_m: Positive = 60.0
    uav_acceleration_m_s2: Positive = 2.0
    airframe: Literal["plain", "px4"] = "plain"
    uav_climb_m_s: Positive = 1.5
    battery: Positive | Literal["none"] = "none"
    message_wait: MessageWait = "wait"
    map_interval_s: Positive = 10.0
    telemetry_s: Positive = 0.5
    link_scores: bool = False


def value_of(settings: Mapping[str, Any], key: str) -> Any:
    """A row's setting, or the default where the row has none; None: there is neither.

    Args:
        settings: Plain values, as a file has them.
        key: A field of `RunSettings`.
    """
    usual = RunSettings.model_fields.get(key)
    plain = usual is not None and isinstance(usual.default, str | int | float)
    return settings.get(key, usual.default if usual and plain else None)


def with_setting(settings: Mapping[str, Any], key: str, value: Any) -> dict[str, Any]:
    """Settings with another value of one; `timers.init_s` is one within another."""
    outer, _, inner = key.partition(".")
    return {**settings, outer: {**settings.get(outer, {}), inner: value} if inner else value}


class Between(BaseModel):
    """A setting that every run draws: it, or its logarithm, evenly from low to high."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    low: float
    high: float
    log: bool = False


Prior = Between | list[Any]
"""What is declared of a setting: numbers, or a list of values that are as likely as each other."""


def draw(prior: Prior, chance: random.Random) -> Any:
    """A value of a setting."""
    if isinstance(prior, list):
        return chance.choice(prior)
    part, low, high = chance.random(), prior.low, prior.high
    return round(low * (high / low) ** part if prior.log else low + (high - low) * part, 4)
