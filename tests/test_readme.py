"""What the README shows works as it stands there."""

import contextlib
import itertools
import re
import subprocess
import sys
from pathlib import Path

from air_router.cli.cli import main
from mocha_link import Team
from tests.distributions import only_mocha_link
from tests.mocha_link.conftest import free_ports, own_host

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
COMMANDS = [line.split("#")[0].strip() for line in README.splitlines() if "    air-router" in line]


@contextlib.contextmanager
def program(snippet, name, folder):
    """A user runs the snippet in a terminal, where only mocha-link is installed."""
    with subprocess.Popen(
        [sys.executable, "-S", "-u", "-c", snippet, name],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=folder,
        env={"PYTHONPATH": str(folder / "site")},
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def test_the_snippet_runs(tmp_path):
    (snippet,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    assert len(snippet.strip().splitlines()) <= 11
    path = Path("missions", "two", "team.yaml")
    host = own_host()
    base = free_ports(host, 2)
    here = {"address": host, "listen": host}
    team = Team.load(ROOT / path).with_robots(
        {name: {"base_port": base + i, **here} for i, name in enumerate("ab")}
    )
    (tmp_path / path).parent.mkdir(parents=True)
    (tmp_path / path).write_text(team.dump())
    only_mocha_link(tmp_path / "site")
    with program(snippet, "a", tmp_path) as a, program(snippet, "b", tmp_path) as b:
        for process, other in ((a, "b"), (b, "a")):
            # Nodes may meet before the snippet subscribes or has published: when the second pull
            # that is announced ends, the other's message is there in any case.
            ends = (
                re.search(rf"SyncEnded\(peer='{other}'.*Direction\.IN", x) for x in process.stdout
            )
            assert len(list(itertools.islice(filter(None, ends), 2))) == 2
        for process, other in ((a, "b"), (b, "a")):
            out, _ = process.communicate("\n", timeout=60)
            assert process.returncode == 0
            # Two threads print: the end of a line of the node's may come after this one.
            assert re.search(rf"{other}: \w+, RTT [\d.e-]+ s, data [\d.e-]+ s old", out)


def test_every_command_and_file_that_is_named_exists():
    named = {c.split()[1] for c in COMMANDS}
    assert named >= {"check", "plan", "edit", "sim", "fly"}
    assert all(main([name, "--help"]) == 0 for name in named)
    for link in re.findall(r"\]\(([^)]+)\)", README):
        if not link.startswith("http"):
            assert (ROOT / link.partition("#")[0]).exists(), link
