"""`air-router preflight`: is this vehicle ready to fly this mission, and if not, what to do."""

import asyncio
import sys
from typing import Final

import click

from air_router.cli.arguments import print_json, uav_option
from air_router.cli.fly import vehicle_of, vehicle_options
from air_router.errors import ExitCode, NotConfirmedError, NoVehicleError, PlanRefusedError
from air_router.mission import FlightPlan, Mission, load_flown, team_of
from air_router.preflight import BAD, GOOD, LOOK, Card, Check, PreflightSurvey
from air_router.record import folder_of, recording_options
from air_router.routing import Router, WaypointGraph
from air_router.vehicle import Telemetry, Vehicle, VehicleClock, VehicleEvent
from mocha_link.cli import PATH, Options, coloured, command, option

TELEMETRY_S: Final = 4.0
"""Wall-clock limit for the first position after the vehicle was found; they come at 10 Hz."""


@command(
    "Run all pre-flight checks and print the pre-flight card. Without --look, upload mission and "
    "fence, read them back, and let PX4 check them. Arms nothing and changes no parameter.",
    "example:\n  air-router preflight missions/pennovation/mission.yaml "
    "--connect udpin://127.0.0.1:14540",
)
@click.argument("mission", type=PATH, help="mission file (.yaml or .plan)")
@vehicle_options
@uav_option
@option("--look", is_flag=True, help="upload nothing, only compare the plan on board")
@recording_options
@option("--json", is_flag=True, help="print one JSON object on stdout")
def run(arguments: Options) -> int:
    """Run the checks, and print the card on stdout."""
    mission = load_flown(arguments.mission, arguments.uav)
    card = asyncio.run(_preflight(mission, arguments))
    if arguments.json:
        print_json(card.as_json())
    else:
        lines = card.lines(coloured=coloured(sys.stdout))
        sys.stdout.write("\n".join(lines) + "\n")
    return ExitCode.DONE if card.ready else ExitCode.REFUSED


async def _preflight(mission: Mission, arguments: Options) -> Card:
    """Connect, check, and disconnect. Raises NoVehicleError, with a diagnosis."""
    alone = arguments.team is None and mission.team is None
    team, uav = (None, "") if alone else team_of(mission, arguments.team)
    clock = VehicleClock()
    survey = PreflightSurvey(
        mission,
        Router(WaypointGraph(mission)),
        team=team,
        uav=uav,
        log_dir=folder_of(arguments),
        clock=clock,
    )
    vehicle = vehicle_of(mission, clock, arguments)
    try:
        info = await vehicle.connect()
        telemetry = await _first_telemetry(vehicle, arguments.connect)
        card = await survey.card(vehicle, info, telemetry)
        flown = info.airframe.why_not_flown is None  # nothing is put on board of another vehicle
        if flown and not (telemetry.armed or telemetry.in_air):
            check = await _plan(vehicle, FlightPlan.of(mission), upload=not arguments.look)
            card = Card((*card.checks, check))
        return card
    finally:
        await vehicle.close()


async def _first_telemetry(vehicle: Vehicle, url: str) -> Telemetry:
    first: asyncio.Future[Telemetry] = asyncio.get_running_loop().create_future()

    def take(event: VehicleEvent) -> None:
        if isinstance(event, Telemetry) and not first.done():
            first.set_result(event)

    vehicle.subscribe(take)
    try:
        async with asyncio.timeout(TELEMETRY_S):
            return await first
    except TimeoutError:
        raise NoVehicleError(f"{url}: the vehicle has stopped sending positions") from None


async def _plan(vehicle: Vehicle, plan: FlightPlan, *, upload: bool) -> Check:
    """The whole plan: put on board, read back, equal, and found fit to be flown."""
    try:
        await (vehicle.upload(plan) if upload else vehicle.recognise(plan))
    except (PlanRefusedError, NotConfirmedError) as error:
        if upload:
            return Check("plan", BAD, str(error), "change the mission, or the vehicle")
        if isinstance(error, NotConfirmedError):
            return Check("plan", LOOK, f"not known: {error}", "run the check again")
        advice = "a flight will put the mission on board"
        return Check("plan", LOOK, f"another one is on board: {error}", advice)
    done = "on board, read back, equal, can be flown" if upload else "on board already"
    return Check("plan", GOOD, f"{done}: {plan.size}")
