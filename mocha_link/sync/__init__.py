"""The protocols between two nodes, without I/O: the original one, and the sync of new nodes.

A node has a `Session` for each peer. Its `Puller` makes one `Pull` after another, with a
`SyncReceiver` for a new node or a `ClientSession` for an original one. Its `Server` makes a
`ServedPull` with a `SyncSender` for each pull of a new node, and uses a `ServerSession` for an
original one. `Peer` has the state that outlives a pull. The encodings are in frames.py and
sync_messages.py, the states of both sides in pull_states.py and send_states.py.
"""

from mocha_link.sync.frames import ANSWER, CHUNKS, OPEN, read_chunks
from mocha_link.sync.peer import Peer
from mocha_link.sync.protocol import (
    ACK,
    CODE_BYTES,
    DENDT,
    DIALLED,
    GDATA,
    GHEAD,
    ID_BYTES,
    SYNC1,
    SYNCF,
    TRIAL_BOOT_ID,
    Action,
    Connect,
    Disconnect,
    Frame,
    NodeContext,
    Reply,
    ReplyDatagram,
    Route,
    Send,
    SendDatagram,
    Standing,
    random_boot_id,
    random_id,
)
from mocha_link.sync.session import Session

__all__ = [
    "ACK",
    "ANSWER",
    "CHUNKS",
    "CODE_BYTES",
    "DENDT",
    "DIALLED",
    "GDATA",
    "GHEAD",
    "ID_BYTES",
    "OPEN",
    "SYNC1",
    "SYNCF",
    "TRIAL_BOOT_ID",
    "Action",
    "Connect",
    "Disconnect",
    "Frame",
    "NodeContext",
    "Peer",
    "Reply",
    "ReplyDatagram",
    "Route",
    "Send",
    "SendDatagram",
    "Session",
    "Standing",
    "random_boot_id",
    "random_id",
    "read_chunks",
]
