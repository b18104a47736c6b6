"""How `fly` sets out, without a vehicle."""

import gc
from pathlib import Path

from air_router.cli.cli import main
from air_router.errors import RefusedError
from air_router.flight.flight import Flight

PENNOVATION = Path(__file__).parents[3] / "missions" / "pennovation" / "mission.yaml"


def test_what_is_there_before_a_flight_is_not_searched_for_garbage_in_it(monkeypatch):
    """A search of all that is loaded blocks the flight loop for as long as 50 ms."""
    frozen = []

    async def run(_flight):
        frozen.append(gc.get_freeze_count())
        raise RefusedError("enough was seen")

    monkeypatch.setattr(Flight, "run", run)
    before = gc.get_freeze_count()
    main(["fly", str(PENNOVATION), "--connect", "udpin://127.0.0.1:1", "--no-record"])
    assert frozen[0] > before
