"""What a bridge remembers over a restart."""

from __future__ import annotations

from mocha_link.bridges.bridge import SPARE, Progress


def test_it_survives_a_restart(tmp_path):
    path = tmp_path / "new" / "state"
    progress = Progress(path)
    assert progress.place is None
    progress.move(("a-1", 5))
    progress.note("/io/pose", "0011")
    progress.close()
    again = Progress(path)
    assert again.place == ("a-1", 5)
    assert again.handed("/io/pose", "0011")
    assert not again.handed("/io/pose", "0012")
    assert not again.handed("/io/path", "0011")
    again.close()


def test_it_forgets_what_is_long_past():
    progress = Progress()
    for number in range(100):
        progress.note("/a", str(number), history=3)
        progress.note("/a", str(number), history=3)
        progress.note("/b", "x")
    known = [number for number in range(100) if progress.handed("/a", str(number))]
    assert known == list(range(100 - 3 - SPARE, 100))
    assert progress.handed("/b", "x")
    progress.close()


def test_a_file_that_is_none(tmp_path, caplog):
    path = tmp_path / "state"
    path.write_bytes(b"not a database" * 100)
    for bad in (path, tmp_path, path / "below"):
        progress = Progress(bad)
        progress.move(("a", 1))
        assert progress.place == ("a", 1)
        progress.close()
        assert f"cannot keep state in {bad}" in caplog.text
    assert path.read_bytes() == b"not a database" * 100
