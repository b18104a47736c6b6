"""Processes of the simulated world: what they print goes into a file of their own."""

import pytest

from air_router.errors import ExitCode, NoVehicleError, RefusedError
from air_router.sim.sim_world import Child


def test_what_a_process_prints_goes_into_no_file_that_a_link_leads_to(tmp_path):
    """In /tmp another user had put links of these names: four of their choice were emptied."""
    victim, log = tmp_path / "victim", tmp_path / "vehicle.log"
    victim.write_text("precious")
    log.symlink_to(victim)
    child = Child("vehicle", ["vehicle", "--nonsense"], log)
    with pytest.raises(NoVehicleError, match="No such option '--nonsense'"):
        child.ready()
    child.stop()
    assert victim.read_text() == "precious"
    assert "No such option" in log.read_text()


def test_a_log_that_cannot_be_written_is_a_refusal(tmp_path):
    (tmp_path / "vehicle.log" / "inner").mkdir(parents=True)
    with pytest.raises(RefusedError, match="name a folder that can be written to") as caught:
        Child("vehicle", [], tmp_path / "vehicle.log")
    assert caught.value.exit_code == ExitCode.REFUSED
