# What `air_router.editor` gives, for type checkers; `__init__.py` says where it is.

from air_router.editor.edits import Move as Move
from air_router.editor.server import EditorServer as EditorServer
from air_router.editor.session import EditSession as EditSession
from air_router.editor.session import MissionFile as MissionFile
from air_router.editor.session import write_starter as write_starter
