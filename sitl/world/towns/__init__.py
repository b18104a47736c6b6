"""Towns: read, generated, drawn."""

from mocha_link.lazy import door

__getattr__, __dir__, __all__ = door(
    __name__,
    {
        "terrain": ("Camera", "Raster", "Road", "LandCover", "layers"),
        "town": ("Cell", "GRAIN_M", "Lattice", "REACHED_M", "SAME_GOAL_M", "Town", "coarse"),
        "town_draws": ("drawn_starts", "scatter"),
        "town_file": ("load_town", "mission_over", "mission_text", "town_text"),
        "town_generator": ("generate",),
        "ways": ("PASSABLE", "Ways", "length_m"),
    },
)
