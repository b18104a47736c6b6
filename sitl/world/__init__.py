"""The simulated world: robots, radio, terrain, cameras."""

from mocha_link.lazy import door

__getattr__, __dir__, __all__ = door(
    __name__,
    {
        "air_to_ground": ("AirLoss", "AirToGround", "HIGHEST_M"),
        "ground_robots": ("Publication",),
        "measured_link": ("MeasuredLink", "air_loss"),
        "obstacles": ("Obstacles",),
        "radio": ("RadioModel", "TownRadio"),
        "world": ("Reading", "STEP_S", "Step", "Truth", "World"),
        "world_file": ("WorldPlan", "load_world"),
    },
)
