"""Settings in words, for legends and tables."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Final

from air_router.counted import counted
from sitl.experiment.campaign.plan import Settings
from sitl.experiment.campaign.results import flat

_UNITS: Final = {"radius_m": "radius {} m"}
_COUNTS: Final = {"uavs": "UAVs", "ugvs": "UGVs"}
_FLAGS: Final = {"passive": ("passive", "seeking")}


def words(settings: Settings, keys: Iterable[str]) -> str:
    """Some settings in words."""
    parts = []
    for key in keys:
        value = settings.get(key)
        if value is None:
            continue
        if key in _FLAGS:
            parts.append(_FLAGS[key][0 if value else 1])
            continue
        parts.append(_UNITS.get(key, "{}").format(phrase(key, value)))
    return ", ".join(parts)


def phrase(key: str, value: Any) -> str:
    """One setting's value, without a name or a unit unless it counts something."""
    if key in _COUNTS:
        return counted(value, _COUNTS[key])
    inner = flat(value).values() if isinstance(value, Mapping) else [value]
    shown = " ".join(f"{v:g}" if isinstance(v, float) else str(v) for v in inner)
    return shown.replace("_", " ")
