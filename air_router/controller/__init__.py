"""The mission controller: telemetry and events in, actions out. Pure."""

from mocha_link.lazy import door

__getattr__, __dir__, __all__ = door(
    __name__,
    {
        "airspace_change": ("counted",),
        "controller": ("Controller",),
        "flight_status": ("AirspaceStatus", "FlightStatus", "TargetStatus"),
        "limits": ("LAG_HOLD_S", "VEHICLE_SILENT_S"),
    },
)
