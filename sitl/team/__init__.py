"""The simulated world as a process: clock, links that can be cut, gossip nodes."""

from mocha_link.lazy import door

__getattr__, __dir__, __all__ = door(
    __name__,
    {
        "derived_team": ("derive_team",),
        "relay": ("RelayedPair", "relayed_pairs"),
        "roles": ("TeamError", "TeamRoles", "check_rovers", "default_team", "roles_of"),
        "team": ("Places", "TeamSimulation"),
        "team_world": ("make_world",),
    },
)
