"""The protocols between two nodes, pure: the original one, and the sync of our nodes."""

from mocha_link.sync.frames import ANSWER, CHUNKS, OPEN, is_reply
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
    is_request,
    random_id,
)
from mocha_link.sync.puller import Puller
from mocha_link.sync.server import Server
from mocha_link.sync.sync_receiver import read_chunks

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
    "Action",
    "Connect",
    "Disconnect",
    "Frame",
    "NodeContext",
    "Peer",
    "Puller",
    "Reply",
    "ReplyDatagram",
    "Route",
    "Send",
    "SendDatagram",
    "Server",
    "Standing",
    "is_reply",
    "is_request",
    "random_id",
    "read_chunks",
]
