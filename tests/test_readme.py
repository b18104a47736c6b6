"""What the README shows works as it stands there."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from air_router.cli import main
from mocha_link import Team
from sitl.free_ports import derive_team

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
COMMANDS = [line.split("#")[0].strip() for line in README.splitlines() if "    air-router" in line]


def test_the_snippet_runs(tmp_path):
    (snippet,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    assert len(snippet.strip().splitlines()) <= 11
    derive_team(
        Team.load(ROOT / "missions" / "pennovation" / "team.yaml"),
        tmp_path / "missions" / "pennovation",
    )
    done = subprocess.run(
        [sys.executable, "-c", snippet],
        input="\n",
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={"PYTHONPATH": str(ROOT)},
        timeout=30,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "MessageStored(peer='titan'" in done.stdout
    for peer in ("callisto", "europa", "io"):
        assert f"{peer} LinkState" in done.stdout


@pytest.mark.parametrize("command", [c for c in COMMANDS if c.split()[1] in {"check", "plan"}])
def test_the_commands_run(command, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "missions").symlink_to(ROOT / "missions")
    assert main(shlex.split(command)[1:]) == 0
    assert capsys.readouterr().out


def test_every_command_and_file_that_is_named_exists():
    named = {c.split()[1] for c in COMMANDS}
    assert named >= {"check", "plan", "edit", "sim", "fly"}
    assert all(main([name, "--help"]) == 0 for name in named)
    for link in re.findall(r"\]\(([^)]+)\)", README):
        if not link.startswith("http"):
            assert (ROOT / link).exists(), link
