"""`python -m benchmarks.mutants [--check] [NAME ...]`: mutation test of the decision code.

Each mutant changes one line and runs only the tests beside that part. --check only tests whether
each mutant applies to exactly one place, and whether its tests exist. A mutant that survives shows
a missing test, unless the program behaves the same; then its row gives the reason. Prints a table;
the exit code is 1 if a mutant survives without a reason.
"""

import argparse
import json
import os
import subprocess
import sys
from collections import defaultdict
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path
from typing import NamedTuple

from benchmarks.patched import ROOT, Change, ChangeError, check


class Mutant(NamedTuple):
    """A one-line mistake.

    Attributes:
        name: On the command line.
        change: The line.
        tests: Files of tests beside the part, below tests/.
        same: Why the program does the same with it; empty: it does not.
    """

    name: str
    change: Change
    tests: tuple[str, ...]
    same: str = ""


def _row(  # noqa: PLR0913, PLR0917 - a row of a table
    name: str, place: str, old: str, new: str, tests: str, same: str = ""
) -> Mutant:
    """A mutant; `place` is package and file, whichever room that is in, `tests` of whatever."""
    package, stem = place.split(".")
    module = ".".join(_only(package, f"{stem}.py").with_suffix("").parts)
    files = tuple(str(_only(f"tests/{package}", f"test_{test}.py")) for test in tests.split())
    return Mutant(name, Change(module, old, new), files, same)


@cache
def _files(folder: str) -> dict[str, list[Path]]:
    """The Python files of a folder and its rooms by their names; paths from the root."""
    found = defaultdict(list)
    for path in (ROOT / folder).rglob("*.py"):
        found[path.name].append(path.relative_to(ROOT))
    return found


def _only(folder: str, name: str) -> Path:
    """The one file of a name, in whichever room of a folder it is; `room/name.py` selects which."""
    named = _files(folder).get(name.rpartition("/")[2], [])
    found = [path for path in named if f"/{path.as_posix()}".endswith(f"/{name}")]
    if len(found) != 1:
        raise ChangeError(f"{folder}: {len(found)} files are called {name}, not one")
    return found[0]


MUTANTS = (
    _row("one jump more", "air_router.command_gate", "refused_jumps >= JUMPS", "refused_jumps > JUMPS",
         "faults_in_flight"),
    _row("passed unchecked", "air_router.navigator",
         "if not self.clear(telemetry, legs[1].to):", "if False:", "navigator"),
    _row("objection of any age", "air_router.navigator", "if age_s > self._gate.reaction_s:", "if False:",
         "faults_in_flight controller navigator px4_hold flight"),
    _row("landing 10 m off", "air_router.states/limits", "LANDING_M: Final = 1.0",
         "LANDING_M: Final = 10.0", "controller control_authority return_planner"),
    _row("near one place", "air_router.return_state", "near = known and all(",
         "near = known and any(",
         "controller control_authority return_planner"),
    _row("no charge left", "air_router.routing/limits", "LANDING_MARGIN: Final = 0.10",
         "LANDING_MARGIN: Final = 0.0", "return_planner preflight controller deviations"),
    _row("carried pose", "air_router.search_state",
         "state is State.SEARCH and event.peer == event.robot", "state is State.SEARCH",
         "controller seeking"),
    _row("end without start", "air_router.search_state", " and event.direction in self._began:", ":",
         "controller"),
    _row("goto timer", "air_router.table", 'timer="hold_s", timer_from=TimerStart.ARRIVAL',
         'timer="hold_s"', "controller command_handler state_table"),
    _row("not received for 30 s", "air_router.controller/limits", "VEHICLE_SILENT_S: Final = 3.0",
         "VEHICLE_SILENT_S: Final = 30.0", "command_handler"),
    _row("put off when ready only", "air_router.table",
         "Spec(HoldState, defers=True", "Spec(HoldState", "command_handler"),
    _row("short overshoot", "air_router.controller/limits", "BRAKING_OVERSHOOT: Final = 1.5",
         "BRAKING_OVERSHOOT: Final = 0.5", "airspace_update"),
    _row("skipped fly on", "air_router.airspace_update", "if before.skipped != now.skipped", "if False",
         "airspace_update mission_reloader"),
    _row("fix back at once", "air_router.vehicle/limits", "INPUT_BACK_S: Final = 3.0",
         "INPUT_BACK_S: Final = 0.0", "input_limits faults_in_flight"),
    _row("late foreign order", "air_router.controller/limits", "FOREIGN_ORDER_S: Final = 1.5", "FOREIGN_ORDER_S: Final = 15.0",
         "safety_monitor faults_in_flight"),
    _row("oldest alike", "air_router.seeking", "age_s >= oldest_s", "age_s > oldest_s",
         "seeking"),
    _row("path of an hour", "air_router.target_list", "pose.stamp_s - 60.0", "pose.stamp_s - 3600.0",
         "target_list search"),
    _row("other UAV not renewed", "air_router.target_list",
         " or now_s - before[1] > SOUGHT_BY_OTHER_S", "", "target_list search several"),
    _row("tries ignored", "air_router.seeking", " / (1 + known.tries)", "", "seeking"),
    _row("left out stays", "air_router.explore_state", "del self.left_out[left_out:]", "del left_out",
         "exploration"),
    _row("sixty holds", "air_router.controller/limits", "RELEASE_HOLDS: Final = 6\n", "RELEASE_HOLDS: Final = 60\n",
         "control_authority faults_in_flight"),
    _row("stuck in others' hands", "air_router.ready_state",
         "rises = self._context.authority.handed_over and telemetry.in_air", "rises = telemetry.in_air",
         "faults_in_flight control_authority"),
    _row("report of the node before", "air_router.controller",
         "if isinstance(self.gate.pending, FlyToNode):", "if False:", "faults_in_flight"),
    _row("drift of metres", "air_router.routing/limits", "HOVER_DRIFT_M: Final = 0.25",
         "HOVER_DRIFT_M: Final = 2.5", "router"),
    _row("lost after ten minutes", "air_router.flight/limits", "VEHICLE_LOST_S: Final = 60.0",
         "VEHICLE_LOST_S: Final = 600.0", "flight"),
    _row("above the threshold", "mocha_link.trigger", "reading.value >= limit",
         "reading.value > limit", "trigger"),
    _row("no hysteresis", "mocha_link.trigger", "limit -= self._settings.hysteresis_db",
         "limit -= 0.0", "trigger"),
    _row("no lingering", "mocha_link.protocol", "LINGER_S = 2.0", "LINGER_S = 0.0", "gossip pull"),
    _row("budget grows", "air_router.command_request", "min(self._at_once, self._left + gained)",
         "self._left + gained", "control"),
    _row("any signature", "air_router.mavlink_signing", "if not hmac.compare_digest(",
         "if False and not hmac.compare_digest(", "mavlink_signing"),
    _row("replays taken", "air_router.mavlink_signing", "if not latest < timestamp < LAST_TIMESTAMP:",
         "if not timestamp < LAST_TIMESTAMP:", "mavlink_signing"),
    _row("new sender of any age", "air_router.px4/limits", "SIGNING_NEW_SENDER_S: Final = 60.0",
         "SIGNING_NEW_SENDER_S: Final = 60e6", "mavlink_signing"),
    _row("unsigned heartbeat", "air_router.mavlink_signing", "= {MessageId.RADIO_STATUS: 185}",
         "= {MessageId.RADIO_STATUS: 185, MessageId.HEARTBEAT: 50}", "mavlink_signing"),
    _row("damaged radio status", "air_router.mavlink_signing", " and is_intact(frame, seed)", "",
         "mavlink_signing"),
    _row("time of the vehicle ignored", "air_router.mavlink_signing",
         "self._latest = max(self._latest, timestamp)", "pass", "mavlink_signing"),
    _row("time not reserved", "air_router.mavlink_signing",
         "self._store(self._reserved)", "self._store(timestamp - 1)", "mavlink_signing"),
    _row("blamed twice", "air_router.mavlink_signing", "if verdict in TAKEN or at >= self._blamed:",
         "if True:", "mavlink_signing"),
    _row("key of the group", "air_router.signing_key", "stat.S_IMODE(mode) & 0o077",
         "stat.S_IMODE(mode) & 0o007", "signing_key"),
    _row("key of zeros", "air_router.signing_key", "if not any(secret):", "if False:", "signing_key"),
    _row("orders before it is known", "air_router.px4_link", " and _is_heartbeat(frame)", "",
         "px4_link"),
    _row("torn frames", "air_router.direct_link", "self._rest = signed[written:]", "pass", "direct_link"),
    _row("key over any network", "air_router.signing_key_command",
         "if not arguments.in_the_clear and", "if False and", "signing_key_command"),
    _row("upload not read back", "air_router.px4_plan",
         "return await self.compare(plan)  # last", "return None  # last", "px4_plan"),
    _row("gap of numbers", "mocha_link.database", "_GAP = 1 << 32", "_GAP = 0",
         "database storage node_storage"),
    _row("flight level as it stands", "air_router.maps/limits", "metres * _COLDEST - _LOWEST_M",
         "metres", "airspace_files"),
    _row("arcs turn one way", "air_router.openair", "clockwise=zone.clockwise)[1:-1]", "clockwise=True)[1:-1]",
         "countries"),
    # Beside those of the review: the controller,
    _row("take-off anywhere", "air_router.ready_state", "away_m > HOME_TOLERANCE_M", "away_m > 1e4",
         "safety_monitor faults_in_flight"),
    _row("reserve ignored", "air_router.envelope", "mission.at_reserve(charge)", "False",
         "deviations controller"),
    _row("through other layers", "air_router.ready_state",
         "telemetry.altitude_m > context.layer_top_m", "False", "safety_monitor several"),
    _row("low legs", "air_router.initial_climb",
         "        if not low(mission, telemetry):\n            self._context.interlocks.climbed()",
         "        if True:\n            self._context.interlocks.climbed()",
         "faults_in_flight control_authority controller several"),
    _row("last hold left out", "air_router.control_authority", "self._hold_at_last(context.authority.releasing)", "pass",
         "control_authority faults_in_flight"),
    _row("compares for ever", "air_router.control_authority", "context.now_s >= self._compared_by_s", "False",
         "control_authority"),
    _row("flies when given up", "air_router.interlocks", "lambda context: context.authority.releasing is not None",
         "lambda context: False", "interlocks control_authority faults_in_flight"),
    _row("flies on when killed", "air_router.telemetry_handler", "None if self._phase.flies else self._phase.killed_now()", "None",
         "faults_in_flight safety_monitor control_authority"),
    _row("failsafe is the pilot", "air_router.control_authority",
         "ControlHolder.FAILSAFE if telemetry.failsafe else ControlHolder.PILOT", "ControlHolder.PILOT",
         "faults_in_flight control_authority"),
    _row("into a new zone", "air_router.airspace_update",
         "elif not inside and not self._clear_onward(telemetry):", "elif False:", "airspace_update"),
    _row("breach by a new zone", "air_router.airspace_update",
         "self._context.airspace.exempt(self._reached(before, now, telemetry))", "pass", "airspace_update faults_in_flight"),
    _row("by items of another plan", "air_router.airspace_update",
         "self._gate.fly_points(instead=event.why_not is not None)", "pass",
         "airspace_update mission_reloader"),
    _row("way home called off", "air_router.command_handler",
         "context.task.state is State.HOME and ending is not None and ending.by_request",
         "context.task.state is State.HOME and ending is not None", "command_handler controller control_authority"),
    # routing,
    _row("any detour out", "air_router.routing/limits", "WAY_OUT_DETOUR: Final = 1.05",
         "WAY_OUT_DETOUR: Final = 10.0", "router"),
    _row("nearer than allowed", "air_router.departure",
         "if self._whole is not None and not self._whole.swept_clear(area):", "if False:", "router"),
    _row("late command", "air_router.departure", "return [*elsewhere, end]",
         "return [end]", "router"),
    _row("no inertia", "air_router.departure",
         "self.moving = self.rest != start or bool(self.pending)", "self.moving = bool(self.pending)",
         "router"),
    _row("whole margin or none", "air_router.router",
         "self._airspace.with_margin(min(tracking.flown_m, most_m))", "self._airspace", "router"),
    _row("leg to a zone", "air_router.router",
         "if self._airspace.point_clear(end) and (whole", "if (whole", "router"),
    _row("no way from afar", "air_router.router", "            if visible:", "            if True:",
         "router"),
    # and the sync.
    _row("budget overspent", "mocha_link.sync_sender", "if not self._limit_bytes:", "if True:",
         "sync_sender pull gossip"),
    _row("unknown is welcome", "mocha_link.sync_sender",
         "self._send_hello(Reception.UNKNOWN)", "self._send_hello(Reception.WELCOME)",
         "sync_sender sync_network"),
    _row("frame counted twice", "mocha_link.sync_receiver",
         "if number < self._next or number in self._ahead:", "if number < self._next:",
         "sync_receiver sync_network"),
    _row("another team's ids", "mocha_link.intake",
         "if peer.agreement.exchanges(key):", "if True:", "other_team sync_receiver"),
    _row("rounds without end", "mocha_link.sync_receiver",
         "hello.reception is Reception.UNKNOWN and not self._is_last_round",
         "hello.reception is Reception.UNKNOWN", "sync_receiver"),
    _row("peer starts anew", "mocha_link.peer", "if boot_id == self._boot_id:", "if True:",
         "sync_network sync_sender"),
    _row("any address token", "mocha_link.peer", "return address_token in self._issued",
         "return True", "forged_openings server"),
    _row("ranges without limit", "mocha_link.reassembly_buffer", "if len(gaps) <= limit:", "if True:", "reassembly_buffer"),
    _row("credit behind TCP", "mocha_link.credit", "_START_GROWTH if self._meter.starting else _GROWTH",
         "_GROWTH", "credit"),
    _row("head start on short links", "mocha_link.served_pull", "SHORT_BYTES = 11 * 1024",
         "SHORT_BYTES = 0", "server"),
    _row("datagrams alone at first", "mocha_link.served_pull", "return opens and", "return False and",
         "server"),
    _row("amplification", "mocha_link.address_proof", "RETURN = 3  #", "RETURN = 300  #",
         "datagram forged_openings"),
    _row("stalled pull lives", "mocha_link.puller", "now.steady_s - pull.alive_s <= STALLED_S:",
         "now.steady_s - pull.alive_s <= 100 * STALLED_S:", "gossip new_pull"),
)  # fmt: skip
"""The mistakes that a reviewer tried, thirty more, and what is to notice each."""


def _problem(mutant: Mutant) -> str | None:
    """Why a mutant does not apply; None: it does."""
    try:
        check([mutant.change])
    except ChangeError as error:
        return str(error)
    return None


def survives(mutant: Mutant) -> bool:
    """Whether the tests pass with it."""
    command = [sys.executable, "-m", "benchmarks.patched", json.dumps([mutant.change])]
    command += ["pytest", "-x", "-q", "-n", "0", "-p", "no:cacheprovider", *mutant.tests]
    done = subprocess.run(  # noqa: S603 - our own tests
        command,
        cwd=ROOT,
        env={**os.environ, "HYPOTHESIS_PROFILE": "ci"},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode not in {0, 1}:
        raise SystemExit(f"{mutant.name}: the tests do not run:\n{done.stdout}{done.stderr}")
    return done.returncode == 0


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.mutants", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="run only these mutants")
    parser.add_argument(
        "--jobs", type=int, default=os.cpu_count() or 1, help="number of parallel mutants"
    )
    parser.add_argument("--check", action="store_true", help="only check that every mutant applies")
    arguments = parser.parse_args()
    chosen = [m for m in MUTANTS if not arguments.names or m.name in arguments.names]
    problems = [f"{mutant.name}: {why}" for mutant in chosen if (why := _problem(mutant))]
    if problems or arguments.check:
        print("\n".join(problems) or f"{len(chosen)} apply")
        return 1 if problems else 0
    killed = missed = 0
    with ThreadPoolExecutor(arguments.jobs) as pool:
        for mutant, survived in zip(chosen, pool.map(survives, chosen), strict=True):
            verdict = "SURVIVED" if survived else "killed"
            if survived and mutant.same:
                verdict = f"the same: {mutant.same}"
            killed += not survived
            missed += survived and not mutant.same
            print(f"{mutant.name:<29} {mutant.change.module:<50} {verdict}", flush=True)
    print(f"{killed} of {len(chosen)} killed, {missed} survived")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
