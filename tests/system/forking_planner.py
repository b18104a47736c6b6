"""A program with a node, a server and clients that forks; prints what parent and child saw.

Run by `test_forked_nodes.py` with a team file and perhaps a storage; not a test itself.
"""

import asyncio
import json
import os
import signal
import sys
import threading
from pathlib import Path

from mocha_link import ForkedError, MetricsServer, Node, PrometheusServer, ServiceClient
from mocha_link.service import ServiceServer

ARGUMENTS = {
    "publish": ("/map", b"child"),
    "published": ("/map", b"child"),
    "flush": ("/map",),
    "latest": ("titan", "/map"),
    "history": ("titan", "/map"),
    "stored_since": (0,),
    "held": ("io",),
    "subscribe": (print,),
    "sync": ("io",),
    "wait_for": (object,),
    "request": ("links",),
    "call": ({},),
}
CHILDREN = 10
LIMIT_S = 20  # of a child; the alarm shows that it hung


def outcome(used, name):
    """What the use of a public name in the child comes to."""
    try:
        found = getattr(used, name)
        if callable(found):
            found = found(*ARGUMENTS.get(name, ()))
        if asyncio.iscoroutine(found):
            asyncio.run(found)
    except ForkedError:
        return "ForkedError"
    except BaseException as error:  # noqa: BLE001 - reported
        return repr(error)
    return "nothing"


def public(kind):
    return [name for name in dir(kind) if not name.startswith("_")]


def in_child(node, client, servers, report, wait):
    """Use everything, then stay alive until the parent has taken its ports again."""
    signal.alarm(LIMIT_S)
    kinds = {"Node": (node, Node), "ServiceClient": (client, ServiceClient)}
    for server in servers:
        kinds[type(server).__name__] = (server, object)
    seen = {
        f"{title}.{name}": outcome(used, name)
        for title, (used, kind) in kinds.items()
        for name in [*public(kind), "close", "start"]
        if name not in ("unreachable", "refused", "server_kind", "server_option")
    }
    try:
        with node:
            pass
    except ForkedError as error:
        seen["with"] = str(error)
    os.write(report, json.dumps(seen).encode() + b"\n")
    os.close(report)
    os.read(wait, 1)


def forked(work):
    """Fork; the child does its work and ends as a program does, with its finalizers."""
    child = os.fork()
    if child == 0:
        work()
        sys.exit(0)
    return child


def main():
    team, storage = sys.argv[1], (sys.argv[2] if len(sys.argv) > 2 else None)
    node = Node(team, "titan", storage=storage)
    node.start()
    busy = threading.Event()

    def publish():
        while not busy.is_set():
            node.publish("/map", b"x" * 100)
            node.links()

    threads = [threading.Thread(target=publish, daemon=True) for _ in range(2)]
    for thread in threads:
        thread.start()
    folder = Path(team).parent
    with (
        ServiceServer(node, f"ipc://{folder}/serve") as server,
        MetricsServer(node, f"ipc://{folder}/metrics") as metrics,
        PrometheusServer(node, ":0") as web,
        ServiceClient(server.endpoint) as client,
    ):
        client.links()
        # Methods that the program took before.
        before = node.links, client.links, node.subscribe(lambda _event: None)
        for _ in range(CHILDREN):  # a lock is held at the moment of some of them

            def use():
                signal.alarm(LIMIT_S)
                for work in (lambda: node.publish("/map", b"y"), *before):
                    try:
                        work()
                    except ForkedError:
                        continue
                    sys.exit(9)

            _, status = os.waitpid(forked(use), 0)
            if status:
                sys.exit(f"a child ended with {status}")
        reports, report = os.pipe()
        wait, go = os.pipe()
        last = forked(
            lambda: (os.close(go), in_child(node, client, (server, metrics, web), report, wait))
        )
        os.close(report)
        with os.fdopen(reports) as text:
            seen = json.loads(text.readline())
        busy.set()
        for thread in threads:
            thread.join()
        client.links()  # the parent's still work
        node.publish("/map", b"last")
        node.close()
    with Node(team, "titan", storage=storage) as again:  # its ports are free, the child lives
        latest = again.latest("titan", "/map")
        os.close(go)
        _, status = os.waitpid(last, 0)
        again.publish("/map", b"after the child's end")
    with Node(team, "titan", storage=storage) as again:
        kept = again.latest("titan", "/map")
    sys.stdout.write(
        json.dumps(
            {
                "child": seen,
                "status": status,
                "before": latest and latest.data.decode(),
                "after": kept and kept.data.decode(),
            }
        )
    )


if __name__ == "__main__":
    main()
