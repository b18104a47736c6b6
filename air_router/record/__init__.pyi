# What `air_router.record` gives, for type checkers; `__init__.py` says where it is.

from air_router.record.foxglove_sdk import foxglove_mcap as foxglove_mcap
from air_router.record.log import Log as Log
from air_router.record.log import Note as Note
from air_router.record.log import RecordEntry as RecordEntry
from air_router.record.record_file import no_folder as no_folder
from air_router.record.recorder import Recorder as Recorder
from air_router.record.recording import ViewerAddress as ViewerAddress
from air_router.record.recording import folder_of as folder_of
from air_router.record.recording import record_argument as record_argument
from air_router.record.recording import record_of as record_of
from air_router.record.recording import recording_options as recording_options
from air_router.record.recording import viewer_option as viewer_option
from air_router.record.recording import viewing as viewing
from air_router.record.replay import RecordedStep as RecordedStep
from air_router.record.replay import Replayer as Replayer
from air_router.record.replay import replay_record as replay_record
from air_router.record.replay import steps_of as steps_of
from air_router.record.serialization import json_of as json_of
from air_router.record.serialization import plain_of as plain_of
