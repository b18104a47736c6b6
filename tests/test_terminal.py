"""The three programs at the terminal: help with examples, logging, completion, colours."""

import io
import logging
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import air_router.cli.cli
import mocha_link.cli.cli
import sitl.cli.cli
from mocha_link.cli.program import coloured, log_level
from tests.command_lines import commands_of, context_of

ROOT = Path(__file__).parents[1]
PROGRAMS = {
    "air-router": air_router.cli.cli,
    "mocha-link": mocha_link.cli.cli,
    "sitl": sitl.cli.cli,
}


ALL = {
    tuple(ctx.command_path.split()): ctx
    for module in PROGRAMS.values()
    for ctx in commands_of(module.PROGRAM)
}


def test_every_command_shows_an_example_that_parses():
    for path, ctx in ALL.items():
        text = re.sub(r"\\\n\s+", "", ctx.get_help())
        assert re.search(r"^examples?:", text, re.MULTILINE), text
        shown = re.findall(rf"^(?:example:)?\s+({path[0]} .*)", text, re.MULTILINE)
        assert shown, path
        for line in shown:
            arguments = shlex.split(re.split(r"\s\s+[(#]| > |; ", line)[0], comments=True)
            context_of(PROGRAMS[path[0]].PROGRAM, arguments[1:])


def test_every_argument_is_described():
    for path, ctx in ALL.items():
        for param in ctx.command.params:
            assert param.help or param.hidden, (path, param)


def test_every_default_is_in_the_help():
    for path, ctx in ALL.items():
        for param in ctx.command.params:
            value = ctx.params.get(param.name)
            if value and not param.hidden:  # an empty one is none
                assert "default" in param.help, (path, param)


def test_levels_before_and_after_the_command():
    def level(arguments):
        return log_level(context_of(air_router.cli.cli.PROGRAM, arguments.split()), logging.WARNING)

    assert level("check m.yaml") == logging.WARNING
    assert level("-v check m.yaml") == level("check m.yaml -v") == logging.INFO
    assert level("check m.yaml -vvvv") == logging.DEBUG
    assert level("-vv check m.yaml --log-level error") == logging.ERROR
    assert level("--log-level info check m.yaml") == logging.INFO


@pytest.mark.parametrize("name", ["Zürich", "b\udcff"])  # the second: no UTF-8 in a file's name
def test_letters_that_the_terminal_lacks_are_escaped(name, tmp_path, monkeypatch):
    mission, raw = ROOT / "missions" / "pennovation" / "mission.yaml", io.BytesIO()
    out = io.TextIOWrapper(raw, encoding="ascii")
    monkeypatch.setattr(sys, "stdout", out)
    target = tmp_path / f"{name}.geojson"
    assert air_router.cli.cli.main(["convert", str(mission), str(target)]) == 0
    out.flush()
    assert target.name.encode("ascii", "backslashreplace") in raw.getvalue()


def test_without_a_standard_output_a_command_works_all_the_same(tmp_path, monkeypatch):
    source = ROOT / "missions" / "pennovation" / "mission.yaml"
    target = tmp_path / "map.geojson"
    monkeypatch.setattr(sys, "stdout", None)
    assert air_router.cli.cli.main(["convert", str(source), str(target)]) == 0
    sys.stdout.close()
    assert target.exists()


@pytest.mark.parametrize("program", PROGRAMS)
def test_the_version(program, capsys):
    assert PROGRAMS[program].main(["--version"]) == 0
    assert re.match(rf"{program} \d", capsys.readouterr().out)


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("air-router re", "plain,replay plain,report"),
        ("air-router sim --se", "plain,--seed plain,--seek"),
        ("air-router sim --seek fr", "plain,freshest"),
        ("air-router check mis", "file,mis"),
        ("mocha-link bridge ro", "plain,ros1 plain,ros2"),
        ("sitl exp", "plain,experiment"),
    ],
)
def test_bash_completes_a_line(line, found, capsys, monkeypatch):
    program, *arguments = line.split()
    monkeypatch.setenv(f"_{program.upper().replace('-', '_')}_COMPLETE", "bash_complete")
    monkeypatch.setenv("COMP_WORDS", line)
    monkeypatch.setenv("COMP_CWORD", str(len(arguments)))
    assert PROGRAMS[program].main([]) == 0
    assert sorted(capsys.readouterr().out.split()) == found.split()


def test_bash_reads_the_script(tmp_path, capsys):
    for program, module in PROGRAMS.items():
        assert module.main(["completion", "bash"]) == 0
        (tmp_path / program).write_text(capsys.readouterr().out)
        subprocess.run(["bash", "-n", program], cwd=tmp_path, check=True)


@pytest.mark.parametrize(
    ("shell", "try_it"),
    [
        ("zsh", "zsh -n script"),
        ("fish", "fish --no-execute script"),
    ],
)
def test_others_get_a_script_that_they_can_read(shell, try_it, capsys, tmp_path):
    assert air_router.cli.cli.main(["completion", shell]) == 0
    text = capsys.readouterr().out
    assert "_AIR_ROUTER_COMPLETE" in text
    (tmp_path / "script").write_text(text)
    if shutil.which(shell) is not None:
        subprocess.run(shlex.split(try_it), cwd=tmp_path, check=True)


@pytest.mark.parametrize(
    ("terminal", "environment", "wanted"),
    [
        (True, {"TERM": "xterm"}, True),
        (True, {"TERM": "xterm", "NO_COLOR": "1"}, False),
        (True, {"TERM": "xterm", "NO_COLOR": ""}, True),  # as no-color.org has it
        (True, {"TERM": "dumb"}, False),
        (True, {}, False),
        (False, {"TERM": "xterm"}, False),
    ],
)
def test_colours_on_a_terminal_only(terminal, environment, wanted, monkeypatch):
    for name in ("NO_COLOR", "TERM"):
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    out = io.StringIO()
    out.isatty = lambda: terminal
    assert coloured(out) is wanted


def test_colours_are_written_only_on_request():
    """Escapes for colours stand where `coloured` decides; the rest is drawing on a terminal."""
    for folder in ("air_router", "mocha_link", "sitl"):
        for path in (ROOT / folder).rglob("*.py"):
            if re.search(r"x1b\[\d*m|033\[", path.read_text(encoding="utf-8")):
                assert path.name in {"card.py", "links_view.py", "terminal.py"}, path
