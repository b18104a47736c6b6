"""`python -m benchmarks.mutants [NAME ...]`: which one-line mistakes the tests of a part notice.

Each row changes one line of the decision code and runs the tests beside that part with it, no
others. A mutant that survives is a test that is missing, unless the program does the same with it:
then its row says why. Prints a table; the exit code is 1 when one survived that must not.
"""

import argparse
import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

from benchmarks.patched import ROOT, Change, check


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
    package, module = place.split(".")
    folder = "tests/" + package
    files = tuple(f"{folder}/test_{test}.py" for test in tests.split())
    return Mutant(name, Change(f"{package}.{module}", old, new), files, same)


MUTANTS = (
    _row("one jump more", "air_router.helm", "refused_jumps >= JUMPS", "refused_jumps > JUMPS",
         "watchkeeper"),
    _row("passed unchecked", "air_router.navigator",
         "return near and self.clear(telemetry, following.to)", "return near", "watchkeeper router",
         same="the leg that follows is checked before it is commanded"),
    _row("objection of any age", "air_router.navigator", "if age_s > self.reaction_s:", "if False:",
         "watchkeeper controller commanded px4_hold flight"),
    _row("landing 10 m off", "air_router.homecoming", "LANDING_M: Final = 1.0",
         "LANDING_M: Final = 10.0", "controller handing homeward"),
    _row("near one place", "air_router.homecoming", "near = known and all(",
         "near = known and any(",
         "controller handing homeward"),
    _row("no charge left", "air_router.homeward", "LANDING_MARGIN: Final = 0.10",
         "LANDING_MARGIN: Final = 0.0", "homeward energy controller milestones"),
    _row("carried pose", "air_router.pursuit",
         "state is State.SEARCH and event.peer == event.robot", "state is State.SEARCH",
         "controller seeking"),
    _row("end without start", "air_router.exchange", " and event.direction in self._open:", ":",
         "controller"),
    _row("goto timer", "air_router.schedule", "in {State.SEARCH, State.GOTO}",
         "in {State.SEARCH}", "controller answering"),
    _row("not heard for 30 s", "air_router.permission", "NOT_HEARD_S: Final = 3.0",
         "NOT_HEARD_S: Final = 30.0", "answering"),
    _row("put off when ready only", "air_router.answering",
         "not in {State.READY, State.HOLD}:", "not in {State.READY}:", "answering"),
    _row("short overshoot", "air_router.renewal", "_OVERSHOOT: Final = 1.5",
         "_OVERSHOOT: Final = 0.5", "renewal"),
    _row("barred fly on", "air_router.renewal", "if before.barred != now.barred", "if False",
         "renewal rereading"),
    _row("fix back at once", "air_router.input_limits", "BACK_S: Final = 3.0",
         "BACK_S: Final = 0.0", "input_limits watchkeeper"),
    _row("late stranger", "air_router.watch", "STRANGE_S: Final = 1.5", "STRANGE_S: Final = 15.0",
         "watch watchkeeper"),
    _row("oldest alike", "air_router.seeking", "self.age_s >= oldest_s", "self.age_s > oldest_s",
         "seeking"),
    _row("path of an hour", "air_router.targets", "pose.stamp_s - 60.0", "pose.stamp_s - 3600.0",
         "targets search"),
    _row("other UAV not renewed", "air_router.targets",
         " or now_s - before[1] > SOUGHT_BY_OTHER_S", "", "targets search several"),
    _row("tries ignored", "air_router.seeking", " / (1 + known.tries)", "", "seeking"),
    _row("left out stays", "air_router.exploration", "del self.left_out[left_out:]", "del left_out",
         "exploration"),
    _row("sixty holds", "air_router.handing", "HOLDS: Final = 6", "HOLDS: Final = 60",
         "handing watchkeeper"),
    _row("stuck in others' hands", "air_router.launch",
         "if not (self.handed_over and telemetry.in_air):", "if not telemetry.in_air:",
         "launch handing"),
    _row("report of the node before", "air_router.watchkeeper",
         "if isinstance(helm.custody.pending, FlyToNode):", "if False:", "watchkeeper"),
    _row("drift of metres", "air_router.departure", "_DRIFT_M = 0.25", "_DRIFT_M = 2.5", "router"),
    _row("lost after ten minutes", "air_router.flight", "LOST_S: Final = 60.0",
         "LOST_S: Final = 600.0", "flight"),
    _row("above the threshold", "mocha_link.trigger", "reading.value >= limit",
         "reading.value > limit", "trigger"),
    _row("no hysteresis", "mocha_link.trigger", "limit -= self._settings.hysteresis_db",
         "limit -= 0.0", "trigger"),
    _row("no lingering", "mocha_link.gossip", "LINGER_S = 2.0", "LINGER_S = 0.0",
         "gossip sync_network datagram new_pull"),
    _row("budget grows", "air_router.budget", "min(self._at_once, self._left + gained)",
         "self._left + gained", "control"),
    _row("upload not read back", "air_router.px4_plan",
         "    await compare_plan(raw, telemetry, plan)\n    try:", "    try:", "px4_plan"),
)  # fmt: skip
"""The mistakes that a reviewer tried, and what is to notice each."""


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
    parser.add_argument("names", nargs="*", metavar="NAME", help="only these")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="at a time")
    arguments = parser.parse_args()
    chosen = [m for m in MUTANTS if not arguments.names or m.name in arguments.names]
    check([mutant.change for mutant in chosen])
    killed = missed = 0
    with ThreadPoolExecutor(arguments.jobs) as pool:
        for mutant, survived in zip(chosen, pool.map(survives, chosen), strict=True):
            verdict = "SURVIVED" if survived else "killed"
            if survived and mutant.same:
                verdict = f"the same: {mutant.same}"
            killed += not survived
            missed += survived and not mutant.same
            print(f"{mutant.name:<28}{mutant.change.module:<26}{verdict}", flush=True)
    print(f"{killed} of {len(chosen)} killed, {missed} survived")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
