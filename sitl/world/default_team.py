"""The team of a mission that names none: one UAV and three ground robots, to try a plan out."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from mocha_link.team.document import Document
from mocha_link.team.team import Team

_TEXT: Final = """
robots:
  titan: {kind: aerial_robot, address: 127.0.1.4, listen: 127.0.0.4, base_port: 24400,
          clients: [callisto, europa, io]}
  callisto: {kind: ground_robot, address: 127.0.1.1, listen: 127.0.0.1, base_port: 24100,
             clients: [europa, io, titan]}
  europa: {kind: ground_robot, address: 127.0.1.2, listen: 127.0.0.2, base_port: 24200,
           clients: [callisto, io, titan]}
  io: {kind: ground_robot, address: 127.0.1.3, listen: 127.0.0.3, base_port: 24300,
       clients: [callisto, europa, titan]}
kinds:
  aerial_robot:
    topics:
      - {name: /map, type: grid/SemanticMap, priority: high, min_interval_s: 5}
      - {name: /pose, type: json/Pose, priority: none, min_interval_s: 1}
  ground_robot:
    topics:
      - {name: /pose, type: json/Pose, priority: high, min_interval_s: 1}
      - {name: /path, type: json/Path, priority: medium}
      - {name: /sightings, type: json/Sightings, priority: low}
"""


def default_team() -> Team:
    """Titan flies; callisto, europa and io drive. Its ports have still to be chosen."""
    return Team.from_document(Document.from_text(_TEXT, Path("the built-in team")))
