"""What CI runs: it does what developers do, and leaves nothing out without a note."""

import re
import shutil
import subprocess

import pytest
import yaml

from tests.distributions import ROOT
from tests.system.looker import installed, lacking

WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
COMMANDS = [
    (path.stem, name, step["run"])
    for path in WORKFLOWS
    for name, job in yaml.safe_load(path.read_text("utf-8"))["jobs"].items()
    for step in [*job["steps"], *job.get("strategy", {}).get("matrix", {}).get("include", [])]
    if "run" in step
]


def test_every_target_that_ci_makes_exists():
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE))
    made = {name for _, _, run in COMMANDS for name in re.findall(r"\bmake ([a-z-]+)", run)}
    assert made <= targets
    every_day = {"lint", "test", "docs", "docs-test", "dist", "dist-test", "coverage"}
    assert every_day | {"rehearse", "sabotage", "explore", "lowest"} <= made


def test_ci_has_every_python_that_the_project_names():
    pyproject = (ROOT / "pyproject.toml").read_text("utf-8")
    named = re.findall(r"Python :: (3\.\d+)", pyproject)
    ci = yaml.safe_load((ROOT / ".github" / "workflows" / "ci.yml").read_text("utf-8"))
    matrix = ci["jobs"]["test"]["strategy"]["matrix"]
    assert matrix["python"] == named
    assert any(each["machine"].endswith("-arm") for each in matrix["include"])


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_a_workflow_may_only_read(path):
    workflow = yaml.safe_load(path.read_text("utf-8"))
    assert workflow["permissions"] == {"contents": "read"}
    for name, job in workflow["jobs"].items():
        writes = {"contents": "write"} if (path.stem, name) == ("release", "publish") else None
        assert job.get("permissions") == writes
        assert 0 < job["timeout-minutes"] <= 360
        for step in job["steps"]:
            assert "${{" not in step.get("run", ""), "values come as variables, not as code"
            if step.get("uses", "").startswith("actions/checkout"):
                assert step["with"]["persist-credentials"] is False


@pytest.mark.skipif(shutil.which("bash") is None, reason="there is no bash")
def test_the_commands_of_the_workflows_are_bash():
    for _, _, run in COMMANDS:
        subprocess.run(["bash", "-n"], input=run, text=True, check=True)


def test_a_missing_browser_fails_in_ci_and_skips_elsewhere():
    with pytest.raises(pytest.fail.Exception, match="CI must have one"):
        lacking({"CI": "true"})
    with pytest.raises(pytest.skip.Exception, match="no Chromium"):
        lacking({})


def test_a_browser_of_playwright_is_found(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("PLAYWRIGHT_BROWSERS_PATH", raising=False)
    assert installed(tmp_path) is None
    shell = tmp_path / ".cache/ms-playwright/chromium_headless_shell-1/chrome-linux/headless_shell"
    shell.parent.mkdir(parents=True)
    shell.touch()
    assert installed(tmp_path) == str(shell)
