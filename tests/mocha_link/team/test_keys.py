"""Key pairs, their files, and the command that makes them."""

import json
import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mocha_link.cli.cli import main
from mocha_link.cli.keys_command import TeamTextError, with_keys
from mocha_link.team import keys
from mocha_link.team.document import Document
from mocha_link.team.keys import KeyFileError, KeyMismatchError, KeysUnavailableError, SecretKey
from mocha_link.team.team import Team
from tests.full_disk import files_of_at_most

PATH = Path("team.yaml")
KINDS = "kinds: {rover: {topics: [{name: /pose, type: json/Pose}]}}\n"
TEAM = f"""\
# The team of the summer.
robots:
  a: {{kind: rover, address: 127.0.0.1, base_port: 10, clients: [b, old]}}   # flow
  b:   # block
    # the ground station
    kind: rover
    address: 127.0.0.1
    base_port: 20
    clients: [a, old]
  old:
    {{kind: rover, address: 127.0.0.1, base_port: 30, clients: [a, b], original: true}}
{KINDS}"""


def mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


@pytest.fixture
def path(tmp_path) -> Path:
    """The file of a team without keys."""
    path = tmp_path / "team.yaml"
    path.write_text(TEAM)
    return path


# The key pair


@given(st.binary(min_size=32, max_size=32), st.binary(max_size=100))
def test_a_signature_proves_who_sent_what(seed, data):
    secret = SecretKey(seed)
    signature = secret.sign(data)
    assert len(signature) == 64
    assert secret.public.proves(signature, data)
    assert not secret.public.proves(signature, data + b"!")
    assert not secret.public.proves(signature[:-1] + bytes([signature[-1] ^ 1]), data)
    assert not SecretKey(bytes(32)).public.proves(signature, data) or seed == bytes(32)
    for noise in (b"", b"short", bytes(64)):
        assert not secret.public.proves(noise, data)


def test_a_secret_does_not_show_itself():
    secret = SecretKey(b"s" * 32)
    for shown in (repr(secret), str(secret)):
        assert "sss" not in shown
        assert secret.curve.hex()[:8] not in shown
        assert secret.public.text in shown


def test_without_the_library_there_is_a_command_to_run(path, monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(keys, "_AVAILABLE", False)
    with pytest.raises(KeysUnavailableError, match="PyNaCl"):
        SecretKey.generate()
    assert main(["keys", str(path)]) == 7
    assert "PyNaCl" in capsys.readouterr().err
    assert not (tmp_path / "keys").exists()
    assert main(["check", str(path)]) == 0


def test_a_robot_without_the_library_runs_without_keys():
    script = (
        "import sys; sys.modules['nacl'] = None\n"
        "import mocha_link, mocha_link.team.keys\n"
        "import mocha_link.store.trust\n"
        "import mocha_link.node.curve, mocha_link.cli.cli\n"
        "assert not mocha_link.team.keys.available()\n"
    )
    subprocess.run([sys.executable, "-c", script], check=True)


# Its file


def test_a_secret_is_kept_for_its_owner(tmp_path):
    secret = SecretKey.generate()
    path = keys.path_of("io", tmp_path)
    before = os.umask(0)
    try:
        keys.write(path, "io", secret)
    finally:
        os.umask(before)
    assert path.name == "io.key"
    assert mode(path) == 0o600
    assert keys.read(path) == secret
    with pytest.raises(KeyFileError, match=r"cannot write .*io\.key: File exists"):
        keys.write(path, "io", SecretKey.generate())
    assert keys.read(path) == secret
    other = SecretKey.generate()
    keys.write(path, "io", other, replace=True)
    assert keys.read(path) == other
    assert mode(path) == 0o600
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("others", [0o640, 0o604, 0o620, 0o602, 0o644])
def test_a_secret_that_others_can_read_is_refused(tmp_path, others):
    path = tmp_path / "io.key"
    keys.write(path, "io", SecretKey.generate())
    path.chmod(others)
    with pytest.raises(KeyFileError, match=rf"others can .*; run: chmod 600 '{path}'"):
        keys.read(path)


@pytest.mark.parametrize("text", ["", "nothing", "x" * 80, "# io\n", "\0" * 40, "é" * 5000])
def test_what_is_no_secret(tmp_path, text):
    path = tmp_path / "io.key"
    path.write_text(text)
    path.chmod(0o600)
    with pytest.raises(KeyFileError, match=r"io\.key is not a secret key"):
        keys.read(path)


def test_the_secret_of_a_robot(tmp_path, team):
    secret, other = SecretKey.generate(), SecretKey.generate()
    with_key = team.with_robots({"io": {"key": secret.public.text}})
    assert keys.secret_key(team, "io", None) is None
    assert keys.secret_key(team, "io", tmp_path) is None
    with pytest.raises(KeyFileError, match=r"team.yaml has a key for io: .* --keys DIR"):
        keys.secret_key(with_key, "io", None)
    with pytest.raises(KeyFileError, match=r"io\.key: No such file or directory"):
        keys.secret_key(with_key, "io", tmp_path)
    keys.write(tmp_path / "io.key", "io", other)
    with pytest.raises(KeyMismatchError, match=r"not the secret of the key that .* has for io"):
        keys.secret_key(with_key, "io", tmp_path)
    keys.write(tmp_path / "io.key", "io", secret, replace=True)
    assert keys.secret_key(with_key, "io", tmp_path) == secret


# The team file


def test_only_the_keys_are_new(path, tmp_path, capsys):
    path.chmod(0o664)
    assert main(["keys", str(path)]) == 0
    a, b = (keys.read(tmp_path / "keys" / f"{name}.key").public.text for name in "ab")
    expected = TEAM.replace("  a: {kind", f'  a: {{key: "{a}", kind')
    expected = expected.replace("    kind: rover\n", f'    key: "{b}"\n    kind: rover\n')
    assert path.read_text() == expected
    assert mode(path) == 0o664
    assert mode(tmp_path / "keys") == 0o700
    assert sorted(each.name for each in tmp_path.rglob("*")) == [
        "a.key",
        "b.key",
        "keys",
        "team.yaml",
    ]
    output = capsys.readouterr()
    assert output.out == (
        f"a: new key; its secret is in {tmp_path}/keys/a.key\n"
        f"b: new key; its secret is in {tmp_path}/keys/b.key\n"
        "old: runs the original MOCHA, which knows no keys\n"
        "\n"
        "protected by keys: a - b\n"
        "NOT protected: a - old (old runs the original MOCHA)\n"
        "NOT protected: b - old (old runs the original MOCHA)\n"
    )
    assert "each secret to its robot alone" in output.err
    team = Team.load(path)
    assert keys.secret_key(team, "a", tmp_path / "keys").public.text == a


def test_a_second_time_changes_nothing(path, tmp_path, capsys):
    assert main(["keys", str(path)]) == 0
    before = {each: each.read_bytes() for each in tmp_path.rglob("*") if each.is_file()}
    capsys.readouterr()
    assert main(["keys", str(path)]) == 0
    assert {each: each.read_bytes() for each in tmp_path.rglob("*") if each.is_file()} == before
    output = capsys.readouterr()
    assert f"a: has its key; its secret is in {tmp_path}/keys/a.key\n" in output.out
    assert not output.err
    (tmp_path / "keys" / "a.key").rename(tmp_path / "a.key")
    assert main(["keys", str(path)]) == 0
    assert f"a: has its key; its secret is not in {tmp_path}/keys\n" in capsys.readouterr().out
    assert path.read_bytes() == before[path]


def test_new_keys_for_a_lost_robot(path, tmp_path, capsys):
    assert main(["keys", str(path)]) == 0
    before, text = Team.load(path), path.read_text()
    assert main(["keys", str(path), "--robot", "b", "--force"]) == 0
    after = Team.load(path)
    assert after.robot("a").key == before.robot("a").key
    assert after.robot("b").key != before.robot("b").key
    assert keys.secret_key(after, "b", tmp_path / "keys")
    assert path.read_text() == text.replace(before.robot("b").key, after.robot("b").key)


def test_nothing_is_written_when_something_is_wrong(path, tmp_path, capsys):
    text = with_keys(TEAM, path, {"b": SecretKey.generate().public.text})
    path.write_text(text)
    keys.write(tmp_path / "b.key", "b", SecretKey.generate())
    assert main(["keys", str(path), "--out", str(tmp_path)]) == 1
    error = capsys.readouterr().err
    assert "b.key is not of the key that the team file has for b" in error
    assert path.read_text() == text
    assert not (tmp_path / "a.key").exists()
    assert main(["keys", str(path), "--robot", "c"]) == 2
    assert main(["keys", str(tmp_path / "none.yaml")]) == 3
    (tmp_path / "file").write_text("")
    assert main(["keys", str(path), "--out", str(tmp_path / "file"), "--robot", "a"]) == 1
    assert path.read_text() == text


def test_lines_to_add_by_hand(path, tmp_path, capsys):
    assert main(["keys", str(path), "--print"]) == 0
    assert path.read_text() == TEAM
    output = capsys.readouterr()
    a, b = (keys.read(tmp_path / "keys" / f"{name}.key").public.text for name in "ab")
    assert output.out == f'robots:\n  a:\n    key: "{a}"\n  b:\n    key: "{b}"\n'
    assert "protected by keys: a - b" in output.err
    assert main(["keys", str(path)]) == 0
    assert main(["keys", str(path), "--print"]) == 0
    assert capsys.readouterr().out.endswith("# every robot that can have a key has one\n")


def test_check_reports_what_is_protected(path, capsys):
    assert main(["check", str(path)]) == 0
    assert "no link is protected by keys ('mocha-link keys' makes them)" in capsys.readouterr().out
    main(["keys", str(path), "--robot", "a"])
    capsys.readouterr()
    assert main(["check", str(path)]) == 0
    assert capsys.readouterr().out.splitlines()[-4:] == [
        "no link is protected:",
        "NOT protected: a - b (b has no key)",
        "NOT protected: a - old (old runs the original MOCHA)",
        "NOT protected: b - old (b has no key)",
    ]
    main(["keys", str(path)])
    capsys.readouterr()
    assert main(["check", str(path)]) == 0
    assert "NOT protected: b - old (old runs the original MOCHA)\n" in capsys.readouterr().out
    assert main(["check", str(path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["links"] == [
        {"robots": ["a", "b"], "open_because": None},
        {"robots": ["a", "old"], "open_because": "old runs the original MOCHA"},
        {"robots": ["b", "old"], "open_because": "old runs the original MOCHA"},
    ]
    path.write_text(TEAM.replace("  a: {", f'  a: {{key: "{"#" * 40}", '))
    assert main(["check", str(path)]) == 1
    assert "key of a in the team file" in capsys.readouterr().err


KEY = SecretKey(b"k" * 32).public.text
VALUES = "kind: rover, address: 127.0.0.1, base_port: 10, clients: []"
BLOCK = VALUES.replace(", ", "\n    ")


@pytest.mark.parametrize(
    ("before", "after"),
    [
        (f"a: {{{VALUES}}}", f'a: {{key: "{KEY}", {VALUES}}}'),
        (f"a: {{\n    {BLOCK.replace(chr(10), ',' + chr(10))}\n  }}", None),
        (f"a: {{{VALUES}, key: null}}", f'a: {{{VALUES}, key: "{KEY}"}}'),
        (f"a: {{{VALUES}, key: }}", None),
        (f"a: {{key: ~, {VALUES}}}", f'a: {{key: "{KEY}", {VALUES}}}'),
        (f"a:\n    {BLOCK}", f'a:\n    key: "{KEY}"\n    {BLOCK}'),
        (f"a: # noted\n    # before\n    {BLOCK}", None),
        (f"a: &x\n    {BLOCK}", f'a: &x\n    key: "{KEY}"\n    {BLOCK}'),
        (f"a:\n    {BLOCK}\n    key:", f'a:\n    {BLOCK}\n    key: "{KEY}"'),
        (f"a:\n    {BLOCK}\n    key:   # none", f'a:\n    {BLOCK}\n    key: "{KEY}"   # none'),
        (f"a:\n    {BLOCK}\n    key: '{'x' * 40}'", f'a:\n    {BLOCK}\n    key: "{KEY}"'),
        (f"a:\n    {BLOCK}\n    key: {'x' * 39}}}", f'a:\n    {BLOCK}\n    key: "{KEY}"'),
        (f'"a": {{{VALUES}}}', f'"a": {{key: "{KEY}", {VALUES}}}'),
    ],
)
@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_in_whatever_way_it_is_written(before, after, newline):
    text = f"{KINDS}robots:\n  {before}\n# the end\n".replace("\n", newline)
    changed = with_keys(text, PATH, {"a": KEY})
    if after is not None:
        assert changed == text.replace(before.replace("\n", newline), after.replace("\n", newline))
    assert Team.from_document(Document.from_text(changed, PATH)).robot("a").key == KEY
    assert with_keys(changed, PATH, {"a": KEY}) == changed
    assert changed.count("#") == text.count("#") + KEY.count("#")
    assert ("\r" in changed) == ("\r" in text)
    assert "\n" not in changed.replace(newline, "")


def test_what_cannot_be_changed_is_left_to_the_user(path, tmp_path, capsys):
    strange = f"{KINDS}robots:\n  a: {{? kind\n : rover, {VALUES.partition(', ')[2]}}}\n"
    path.write_text(strange)
    assert Team.load(path)
    with pytest.raises(TeamTextError, match="add the lines by hand"):
        with_keys(strange, path, {"a": KEY})
    assert main(["keys", str(path)]) == 1
    assert not (tmp_path / "keys").exists()
    assert main(["keys", str(path), "--print"]) == 0
    assert capsys.readouterr().out.startswith("robots:\n  a:\n    key: ")


def test_a_mark_at_the_start_and_a_link_stay(tmp_path):
    real = tmp_path / "real.yaml"
    real.write_bytes(b"\xef\xbb\xbf" + TEAM.encode())
    link = tmp_path / "team.yaml"
    link.symlink_to(real)
    assert main(["keys", str(link)]) == 0
    assert link.is_symlink()
    assert real.read_bytes().startswith(b"\xef\xbb\xbf# The team")
    assert Team.load(link).robot("a").key


def test_a_team_file_that_cannot_be_written(path, capsys, monkeypatch):

    def refuse(*_):
        raise PermissionError(13, "Permission denied")

    with monkeypatch.context() as patched:
        patched.setattr(Path, "replace", refuse)
        assert main(["keys", str(path)]) == 1
    assert f"cannot write {path}: Permission denied" in capsys.readouterr().err
    assert path.read_text() == TEAM
    assert main(["keys", str(path)]) == 0  # goes on with the secrets that are there
    assert "a: key added" in capsys.readouterr().out


# All robots at once: a folder for each


def tree(folder: Path) -> dict[str, tuple[int, bytes, int]]:
    """Mode, content and time of every file."""
    files = (path for path in folder.rglob("*") if path.is_file())
    return {
        str(path.relative_to(folder)): (mode(path), path.read_bytes(), path.stat().st_mtime_ns)
        for path in files
    }


def test_one_command_makes_what_each_robot_needs(path, tmp_path, capsys):
    assert main(["keys", "--team", str(path)]) == 0
    out = capsys.readouterr().out
    made = tree(tmp_path / "keys")
    assert set(made) == {"a/a.key", "a/team.yaml", "b/b.key", "b/team.yaml"}  # old has no key
    assert {mode(tmp_path / "keys" / name) for name in "ab"} == {0o700}
    team = Team.load(path)
    for name in "ab":
        assert made[f"{name}/{name}.key"][0] == 0o600
        folder = tmp_path / "keys" / name
        assert keys.secret_key(Team.load(folder / "team.yaml"), name, folder)
        assert f"scp -p {folder}/* {team.robot(name).address}:/etc/mocha-link/" in out
        assert f"mocha-link node /etc/mocha-link/team.yaml --robot {name} --keys" in out
    assert "old: runs the original MOCHA" in out
    assert "protected by keys: a - b" in out


def test_a_second_time_it_changes_nothing(path, tmp_path, capsys):
    assert main(["keys", "--team", str(path)]) == 0
    made, team = tree(tmp_path / "keys"), path.stat().st_mtime_ns
    assert main(["keys", "--team", str(path)]) == 0
    assert tree(tmp_path / "keys") == made
    assert path.stat().st_mtime_ns == team


def test_a_robot_that_joins_gets_its_folder_and_all_get_the_new_team_file(path, tmp_path):
    assert main(["keys", "--team", str(path)]) == 0
    before = tree(tmp_path / "keys")
    robot = "  c: {kind: rover, address: 127.0.0.1, base_port: 40, clients: []}\n"
    path.write_text(path.read_text().replace("kinds:", robot + "kinds:"))
    assert main(["keys", "--team", str(path)]) == 0
    after = tree(tmp_path / "keys")
    assert set(after) - set(before) == {"c/c.key", "c/team.yaml"}
    for name in "ab":
        assert after[f"{name}/{name}.key"] == before[f"{name}/{name}.key"]
        assert after[f"{name}/team.yaml"][1] == path.read_bytes()


def test_the_team_file_of_a_robot_stays_whole_when_the_disk_is_full(path, tmp_path, capsys):
    assert main(["keys", "--team", str(path)]) == 0
    before = tree(tmp_path / "keys")
    path.write_text(path.read_text() + "# changed\n")
    with files_of_at_most(100):
        assert main(["keys", "--team", str(path)]) == 1
    copy = tmp_path / "keys" / "a" / "team.yaml"
    assert f"cannot write {copy}: File too large" in capsys.readouterr().err
    assert tree(tmp_path / "keys") == before


@pytest.mark.parametrize(
    ("address", "place"),
    [
        (None, "ADDRESS-OF-a:/etc/mocha-link/"),
        ("a.local", "a.local:/etc/mocha-link/"),
        ("fd00::2", "'[fd00::2]:/etc/mocha-link/'"),
        ("fe80::2%wlan0", "'[fe80::2%wlan0]:/etc/mocha-link/'"),
    ],
)
def test_the_command_that_copies_has_a_place_that_scp_takes(path, capsys, address, place):
    first = f'address: "{address}", ' if address else ""
    path.write_text(
        f"robots:\n  a: {{kind: rover, {first}base_port: 10, clients: [b]}}\n"
        f"  b: {{kind: rover, address: 127.0.0.1, base_port: 20, clients: [a]}}\n{KINDS}"
    )
    assert main(["keys", "--team", str(path)]) == 0
    assert f"/keys/a/* {place}\n" in capsys.readouterr().out


def test_secrets_that_an_earlier_command_made_are_laid_out(path, tmp_path):
    assert main(["keys", str(path)]) == 0
    assert main(["keys", "--team", str(path)]) == 0
    for name in "ab":
        folder = tmp_path / "keys" / name
        assert keys.secret_key(Team.load(folder / "team.yaml"), name, folder)
        assert mode(folder / f"{name}.key") == 0o600


def test_a_secret_of_another_key_is_never_overwritten(path, tmp_path, capsys):
    place = tmp_path / "keys" / "a" / "a.key"
    assert main(["keys", "--team", str(path)]) == 0
    place.unlink()
    keys.write(place, "a", SecretKey.generate())
    before = tree(tmp_path)
    assert main(["keys", "--team", str(path)]) == 1
    assert f"the secret in {place} is not of the key" in capsys.readouterr().err
    assert tree(tmp_path) == before


def test_a_missing_secret_is_reported(path, tmp_path, capsys):
    assert main(["keys", "--team", str(path)]) == 0
    (tmp_path / "keys" / "b" / "b.key").unlink()
    capsys.readouterr()
    assert main(["keys", "--team", str(path)]) == 0
    out = capsys.readouterr().out
    assert f"b: its secret is not here; {tmp_path / 'keys' / 'b' / 'team.yaml'} is its new" in out
    assert f"scp -p {tmp_path / 'keys' / 'b'}" not in out


@pytest.mark.parametrize(
    "options",
    [
        [],
        ["--team", "TEAM", "TEAM"],
        ["--team", "TEAM", "--force"],
        ["--team", "TEAM", "--print"],
        ["--team", "TEAM", "--robot", "a"],
    ],
)
def test_options_that_do_not_go_together_are_wrong_usage(path, tmp_path, capsys, options):
    assert main(["keys", *(str(path) if each == "TEAM" else each for each in options)]) == 2
    assert "TEAM" in capsys.readouterr().err
    assert path.read_text() == TEAM
    assert not (tmp_path / "keys").exists()


# Ports that need no key


def exposed(path, capsys, caplog) -> tuple[str, list[str]]:
    """What `check` warns of, in its log and for scripts."""
    caplog.clear()
    assert main(["check", str(path), "--json"]) == 0
    logged = "".join(f"{record.levelname} {record.message}\n" for record in caplog.records)
    return logged, json.loads(capsys.readouterr().out)["exposed"]


def test_check_warns_once_of_all_ports_without_keys_that_others_can_reach(path, capsys, caplog):
    warning, names = exposed(path, capsys, caplog)
    assert names == ["a", "b", "old"]
    assert warning.count("WARNING NO KEYS") == warning.count("\n") == 1
    assert "a on every interface, port 10, 11; b on every interface, port 20, 21" in warning
    assert f"mocha-link keys --team {path}" in warning


def test_keys_or_loopback_are_no_exposure(path, capsys, caplog):
    main(["keys", "--team", str(path)])
    capsys.readouterr()
    warning, names = exposed(path, capsys, caplog)
    assert names == ["a", "b", "old"]  # the original node has no key: these two serve it openly
    assert "a on every interface, port 11; b on every interface, port 21" in warning
    text = path.read_text()
    path.write_text(text.replace("127.0.0.1,", "127.0.0.1, listen: 127.0.0.1,"))
    assert exposed(path, capsys, caplog)[1] == ["b"]
    text = path.read_text()
    path.write_text(text.replace("    base_port: 20", "    listen: 127.0.0.2\n    base_port: 20"))
    assert exposed(path, capsys, caplog) == ("", [])


def test_a_robot_without_peers_is_no_exposure(tmp_path, capsys, caplog):
    path = tmp_path / "alone.yaml"
    path.write_text(
        f"robots: {{a: {{kind: rover, address: h, base_port: 1, clients: []}}}}\n{KINDS}"
    )
    assert exposed(path, capsys, caplog) == ("", [])
