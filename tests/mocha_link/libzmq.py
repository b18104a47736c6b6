"""libzmq as the other end: what other programs, and nodes of others, connect with and bind."""

import zmq
from zmq.utils import z85

from mocha_link.service.endpoint import save_key


def protect(client: zmq.Socket, secret, server) -> None:
    """Have a socket, before it connects, talk to the holder of the server's key, encrypted."""
    client.curve_serverkey = z85.encode(server.curve)
    client.curve_publickey = z85.encode(secret.public.curve)
    client.curve_secretkey = z85.encode(secret.curve)


def bind(server: zmq.Socket, endpoint: str) -> str:
    """Bind at an endpoint, a TCP one with a key that this user's programs find; returns where."""
    if endpoint.startswith("tcp"):
        _, server.curve_secretkey = key = zmq.curve_keypair()
        server.curve_server = True
        server.bind(endpoint)
        save_key(server.last_endpoint.decode(), key)
    else:
        server.bind(endpoint)
    return server.last_endpoint.decode()
