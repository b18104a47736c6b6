"""How `edit` sets out, without a page."""

import gc
import shutil
from pathlib import Path

from air_router.cli import edit
from air_router.cli.cli import main

PENNOVATION = Path(__file__).parents[3] / "missions" / "pennovation"


def test_no_key_waits_for_a_search_for_garbage(tmp_path, monkeypatch):
    """A search of all that a few edits of a large mission have made takes 50 ms."""
    searching = []
    monkeypatch.setattr(edit, "show", lambda _page, _say: searching.append(gc.isenabled()))
    shutil.copytree(PENNOVATION, tmp_path / "pennovation")
    try:
        main(["edit", str(tmp_path / "pennovation" / "mission.yaml"), "--port", "0", "--no-open"])
    finally:
        gc.enable()
    assert searching == [False]
