"""The protocols between two nodes, pure: the original one, and the sync of our nodes.

A node has a `Session` for each peer. Its `Puller` makes one `Pull` after another: by `SyncReceiver`
from a node of ours, by `ClientSession` from an original one. Its `Server` has a `ServedPull` for
each pull of the peer, with `SyncSender`, or a `ServerSession` for an original node. `Peer` is what
outlives a pull. The bytes are in frames.py and sync_messages.py, the states of either side in
pull_states.py and send_states.py.
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
