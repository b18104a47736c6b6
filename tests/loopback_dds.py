"""DDS on the loopback interface; the fixture `domain` has the number of a domain."""

import time

CONFIG = """
<CycloneDDS><Domain Id="any"><General>
<Interfaces><NetworkInterface name="lo" multicast="false"/></Interfaces>
<AllowMulticast>false</AllowMulticast>
</General><Discovery><Peers><Peer Address="127.0.0.1"/></Peers>
<ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>100</MaxAutoParticipantIndex>
</Discovery></Domain></CycloneDDS>
"""


def taken(reader):
    """What comes; DDS has no order between matching and writing, so this may take a while."""
    until_s = time.monotonic() + 60
    while time.monotonic() < until_s:
        for sample in reader.take(1):
            return sample
    raise AssertionError("nothing came")
