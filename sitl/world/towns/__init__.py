"""Towns: what stands where; read, made, drawn."""

from mocha_link.lazy import door

__getattr__, __dir__, __all__ = door(
    __name__,
    {
        "terrain": ("Camera", "Raster", "Road", "Scene", "layers"),
        "town": ("Cell", "GRAIN_M", "Lattice", "REACHED_M", "SAME_GOAL_M", "Town", "coarse"),
        "town_file": ("load_town", "mission_over", "mission_text", "town_text"),
        "town_generator": ("drawn_starts", "generate", "scatter"),
        "ways": ("PASSABLE", "Ways", "length_m"),
    },
)
