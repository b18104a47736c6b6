"""Names in the field: the name server goes out of reach together with everybody else."""

from __future__ import annotations

from mocha_link.node.resolver import FRESH_S, RETRY_S
from tests.mocha_link.node.test_resolver import Woken, names, time_s

__all__ = ["names", "time_s"]  # fixtures


def test_an_address_that_was_good_stays_while_the_name_server_is_out_of_reach(names, time_s):
    names.known["titan.local"] = "10.0.0.4"
    resolver = Woken()
    resolver.address("titan.local")
    resolver.wait()
    del names.known["titan.local"]
    for _ in range(3):
        time_s[0] += FRESH_S + 1
        assert resolver.address("titan.local") == "10.0.0.4"
        resolver.wait()
        assert resolver.address("titan.local") == "10.0.0.4"
        assert resolver.failure("titan.local") is None
    names.known["titan.local"] = "10.0.0.5"
    time_s[0] += RETRY_S + 1  # asked for again sooner than if all were well
    resolver.address("titan.local")
    resolver.wait()
    assert resolver.address("titan.local") == "10.0.0.5"
