"""The three programs at the terminal: help with examples, logging, completion, colours."""

import argparse
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
from mocha_link.cli.program import coloured, log_level, script

ROOT = Path(__file__).parents[1]
PROGRAMS = {
    "air-router": air_router.cli.cli,
    "mocha-link": mocha_link.cli.cli,
    "sitl": sitl.cli.cli,
}


def commands(parser, path=()):
    """Every command of a parser, with its parser."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, command in action.choices.items():
                yield (*path, name), command
                yield from commands(command, (*path, name))


PARSERS = {program: module.PROGRAM.parser() for program, module in PROGRAMS.items()}
ALL = {
    (program, *path): command
    for program, parser in PARSERS.items()
    for path, command in commands(parser)
}


def test_every_command_shows_an_example_that_parses():
    for path, command in ALL.items():
        text = re.sub(r"\\\n\s+", "", command.format_help())
        assert re.search(r"^examples?:", text, re.MULTILINE), text
        shown = re.findall(rf"^(?:example:)?\s+({path[0]} .*)", text, re.MULTILINE)
        assert shown, path
        for line in shown:
            words = shlex.split(re.split(r"\s\s+[(#]| > |; ", line)[0], comments=True)
            PARSERS[path[0]].parse_args(words[1:])


def test_every_argument_says_what_it_is():
    for path, command in ALL.items():
        for action in command._actions:
            assert action.help or isinstance(action, argparse._SubParsersAction), (path, action)


def test_levels_before_and_after_the_command():
    def level(words):
        return log_level(
            air_router.cli.cli.PROGRAM.parser().parse_args(words.split()), logging.WARNING
        )

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
    with pytest.raises(SystemExit) as end:
        PARSERS[program].parse_args(["--version"])
    assert end.value.code == 0
    assert re.match(rf"{program} \d", capsys.readouterr().out)


def test_bash_completes(tmp_path):
    (tmp_path / "mission.yaml").touch()
    for program, module in PROGRAMS.items():
        (tmp_path / program).write_text(script(module.PROGRAM.parser(), "bash"))
    asked = {
        "air-router re": "replay report",
        "air-router sim --se": "--seek --seed",
        "air-router sim --seek fr": "freshest",
        "air-router check mis": "mission.yaml",
        "mocha-link bridge ro": "ros1 ros2",
        "sitl exp": "experiment",
    }
    program = ["for p in *-* sitl; do source ./$p; done"]
    for words in asked:
        name, *rest = words.split()
        program.append(
            f"COMP_WORDS=({words}); COMP_CWORD={len(rest)}; COMPREPLY=(); "
            f'_shtab_{name.replace("-", "_")}; echo "${{COMPREPLY[@]}}"'
        )
    done = subprocess.run(
        ["bash", "-c", "\n".join(program)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.splitlines() == list(asked.values())


@pytest.mark.parametrize(
    ("shell", "try_it"),
    [
        ("zsh", "zsh -n script"),
        ("fish", "fish --no-config -c 'source script; complete -C \"air-router sim --seek fr\"'"),
    ],
)
def test_others_get_a_script_that_they_can_read(shell, try_it, capsys, tmp_path):
    assert air_router.cli.cli.main(["completion", shell]) == 0
    text = capsys.readouterr().out
    assert "preflight" in text
    (tmp_path / "script").write_text(text)
    if shutil.which(shell) is not None:
        done = subprocess.run(
            shlex.split(try_it), cwd=tmp_path, capture_output=True, text=True, check=True
        )
        found = done.stdout.split()[:1]  # what it is follows
        assert (found, done.stderr) == (["freshest"] if shell == "fish" else [], "")


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


def test_only_those_who_ask_write_colours():
    """Escapes for colours stand where `coloured` decides; the rest is drawing on a terminal."""
    for folder in ("air_router", "mocha_link", "sitl"):
        for path in (ROOT / folder).rglob("*.py"):
            if re.search(r"x1b\[\d*m|033\[", path.read_text(encoding="utf-8")):
                assert path.name in {"card.py", "links_view.py", "terminal.py"}, path
