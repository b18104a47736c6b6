"""Message waits and contention with real nodes: `python -m benchmarks.contention`.

The experiments predict how long messages wait for a channel that one robot uses at a time. Here the
same teams meet at the same times and publish the same messages, but every robot is a process with a
node of its own, whose TCP connections lead through a relay that has that channel. What differs is
what the experiments leave out: sockets, threads, processes, and that nodes take time to answer.
"""
