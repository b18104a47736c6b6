"""What a web page can send to a port of this machine: an HTTP POST, read as ZMTP 1.0.

ZMTP 1.0 has no greeting: a length byte (flags included), a flags byte whose lowest bit means that
more frames follow, the frame. The page does not choose how its request begins, but all of its body:
where the frames that libzmq makes of the head end, in the body, those that count begin.
"""

SIZE = 400


def body(head: bytes, request: bytes) -> bytes:
    """A body of SIZE bytes which, behind that head, is a message of its own."""
    at = 0
    padded = head + b"\x01" * 256  # the last frame of the head ends in the body
    while at < len(head):
        at += 1 + padded[at]
    start = at - len(head)
    frames = b"\x01\x00" + bytes((len(request) + 1, 0)) + request
    return (b"\x01" * start + frames).ljust(SIZE, b"\x01")


def post(port: int, request: bytes) -> bytes:
    """The whole of a POST, as a program sends it that is no browser."""
    head = (
        f"POST / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUser-Agent: a page\r\n"
        f"Content-Type: text/plain\r\nContent-Length: {SIZE}\r\n\r\n"
    ).encode()
    return head + body(head, request)
