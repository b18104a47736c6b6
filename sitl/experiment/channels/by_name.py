"""The channel that the settings name."""

from __future__ import annotations

from collections.abc import Sequence

from sitl.experiment.channels.channel import Channel
from sitl.experiment.channels.paper import PaperChannel
from sitl.experiment.channels.path_loss import PathLossChannel
from sitl.experiment.channels.trace import TraceChannel
from sitl.experiment.settings import RunSettings
from sitl.experiment.towns.town import Town


def channel_of(settings: RunSettings, town: Town, names: Sequence[str], seed: int) -> Channel:
    """The channel of a run.

    Raises:
        ValueError: a trace is asked for, and none is named.
        TraceError: the trace is none.
    """
    match settings.channel:
        case "paper":
            return PaperChannel(settings.paper, settings.radius_m, len(names), seed)
        case "path_loss":
            return PathLossChannel(settings.path_loss, town, names, seed)
        case "trace":
            if settings.trace is None:
                raise ValueError("the channel is a trace, and no trace is named; write trace: path")
            return TraceChannel(settings.trace, names)
