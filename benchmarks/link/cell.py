"""One measurement: a way on a link, with two nodes as processes in namespaces of their own."""

import contextlib
import multiprocessing
import os
import socket
import time
import traceback
from dataclasses import dataclass, field
from multiprocessing.connection import Connection

from benchmarks.link import namespaces
from benchmarks.link.budget import Budget, needs
from benchmarks.link.emulator import Emulator
from benchmarks.link.links import Link
from benchmarks.link.offer import Offer
from benchmarks.link.score import Score
from benchmarks.link.ways import ADDRESSES, ENDED, WAYS, Side

START_S = 600.0  # to get ready, when many others do so as well
SETTLE_S = 0.5  # to take in what had arrived when the last contact ended
END_S = 600.0
STARVED_NICE = 19  # of the nodes where they are to want for a core

PROCESSES = multiprocessing.get_context("fork")


@dataclass(frozen=True, slots=True)
class Report:
    """What the wanting node saw: when which message was complete, and which were wrong."""

    delivered: tuple[tuple[float, int], ...] = ()
    damaged: tuple[int, ...] = ()
    cpu_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Task:
    """What to measure."""

    way: str
    link: Link
    seed: int
    equal: tuple[int, int] | None = None  # not the usual offer: so many messages of so many bytes
    nice: int = 0  # of the two nodes, not of the link

    @property
    def offer(self) -> Offer:
        if self.equal:
            count, size = self.equal
            return Offer.of(count, self.seed, size=size)
        return Offer.for_link(self.link, self.seed)


@dataclass(slots=True)
class _Agent:
    process: multiprocessing.process.BaseProcess
    control: Connection
    interface: int = field(default=-1)


def measure(task: Task, budget: Budget) -> Score:
    """Run one task; takes as long as its contacts and gaps.

    Raises:
        EmulationError: this machine does not let us emulate links.
        RuntimeError: one of the nodes failed.
    """
    agents: list[_Agent] = []
    try:
        agents.extend(_begin(task, number, budget) for number in range(2))
        namespaces.be_punctual()
        for agent in agents:
            _expect(agent, "ready", START_S)
        emulator = Emulator(task.link, (agents[0].interface, agents[1].interface), task.seed)

        def report(received: bool) -> None:
            for agent in agents:
                agent.control.send("received" if received else "lost")

        began_s = time.process_time()
        emulator.run(report, lambda: budget.use(needs(task.way, task.link.rate_bit_s)))
        cpu_s = time.process_time() - began_s
        time.sleep(SETTLE_S)
        for agent in agents:
            agent.control.send("end")
        reports = [_expect_report(agent) for agent in agents]
        seen = reports[1]
        return Score.of(
            task.way,
            task.link,
            offer=task.offer,
            emulator=emulator,
            delivered=seen.delivered,
            damaged=seen.damaged,
            cpu_s=cpu_s + sum(each.cpu_s for each in reports),
        )
    finally:
        for agent in agents:
            _end(agent)


def _begin(task: Task, number: int, budget: Budget) -> _Agent:
    control, theirs = PROCESSES.Pipe()
    ours, passing = socket.socketpair()
    process = PROCESSES.Process(target=_agent, args=(task, number, budget, theirs, passing))
    process.start()
    theirs.close()
    passing.close()
    agent = _Agent(process, control)
    with ours:
        _, descriptors, _, _ = socket.recv_fds(ours, 1, 1)
    if descriptors:
        agent.interface = descriptors[0]
    else:
        _expect(agent, "interface", START_S)
    return agent


def _expect_report(agent: _Agent) -> Report:
    report = _expect(agent, "report", END_S)
    if not isinstance(report, Report):
        raise TypeError(f"no report but {report!r}")
    return report


def _expect(agent: _Agent, what: str, timeout_s: float) -> object:
    if not agent.control.poll(timeout_s):
        raise RuntimeError(f"a node was not done with '{what}' within {timeout_s:g} s")
    try:
        got, value = agent.control.recv()
    except EOFError:
        raise RuntimeError("a node is gone") from None
    if got == "forbidden":
        raise namespaces.EmulationError(value)
    if got != what:
        raise RuntimeError(f"a node failed:\n{value}")
    return value


def _end(agent: _Agent) -> None:
    agent.process.join(1)
    if agent.process.is_alive():
        agent.process.kill()
        agent.process.join()
    agent.control.close()
    if agent.interface >= 0:
        os.close(agent.interface)


def _agent(
    task: Task, number: int, budget: Budget, control: Connection, passing: socket.socket
) -> None:
    """The main of a node's process."""
    namespaces.end_with_parent()
    os.nice(task.nice)
    try:
        namespaces.enter()
        interface = namespaces.open_interface(ADDRESSES[number])
        socket.send_fds(passing, [b"i"], [interface])
        os.close(interface)
        passing.close()
        control.send(("report", _live(task, number, budget, control)))
    except namespaces.EmulationError as error:
        control.send(("forbidden", str(error)))
    except Exception:  # noqa: BLE001 - whatever it was, the measuring process reports it
        with contextlib.suppress(OSError):
            control.send(("failed", traceback.format_exc()))
    finally:
        passing.close()
        control.close()
        os._exit(0)  # threads of libraries that hang must not keep the process


def _live(task: Task, number: int, budget: Budget, control: Connection) -> Report:
    way = WAYS[task.way]
    offer = task.offer
    delivered: list[tuple[float, int]] = []

    def deliver(key: int) -> None:
        delivered.append((time.monotonic(), key))

    with budget.use(1.0):
        side: Side = way.make_sink(offer, deliver) if number else way.make_source(offer)
        side.start()
    began_s = time.process_time()
    control.send(("ready", None))
    in_contact = False
    while (order := control.recv()) != "end":
        if order == "received":
            side.signal_received(again=in_contact)
            in_contact = True
        else:
            side.lost()
            in_contact = False
    cpu_s = time.process_time() - began_s
    side.close()
    with budget.use(1.0):
        damaged = tuple(
            key for _, key in delivered if key != ENDED and side.data(key) != offer.data(key)
        )
    return Report(tuple(delivered), damaged, cpu_s)
