"""Shortest clear paths between places, without a graph."""

from geo.paths.free_space import HAIR_M, FreeSpace
from geo.paths.mesh import Mesh
from geo.paths.polyanya import Source
from geo.paths.separators import barriers
from geo.paths.shortest import ShortestPaths, path_length_m, shortest_path, shortest_paths

__all__ = [
    "HAIR_M",
    "FreeSpace",
    "Mesh",
    "ShortestPaths",
    "Source",
    "barriers",
    "path_length_m",
    "shortest_path",
    "shortest_paths",
]
