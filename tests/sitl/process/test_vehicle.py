import select
import socket

import pytest

from sitl.process.vehicle import PortInUseError, UdpLink

LIMIT_S = 60


def udp_socket():
    end = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    end.bind(("127.0.0.1", 0))
    end.settimeout(LIMIT_S)
    return end


def test_the_first_talker_becomes_the_partner_for_good():
    with udp_socket() as expected, udp_socket() as first, udp_socket() as second:
        link = UdpLink(("127.0.0.1", 0), expected.getsockname(), "API link")
        link.send([b"one"])
        assert expected.recv(100) == b"one"
        for client in (first, second):
            client.sendto(b"hello", ("127.0.0.1", link.port))
            assert select.select([link], [], [], LIMIT_S)[0]
            assert link.receive() == [b"hello"]  # every sender is received
            link.send([b"two"])
            assert first.recv(100) == b"two"  # one is answered
        link.close()


def test_a_partner_that_was_named_for_good_stays_whoever_talks():
    with udp_socket() as named, udp_socket() as stranger:
        link = UdpLink(("127.0.0.1", 0), named.getsockname(), "truth", fixed=True)
        stranger.sendto(b"for the program before", ("127.0.0.1", link.port))
        assert select.select([link], [], [], LIMIT_S)[0]
        link.receive()
        link.send([b"truth"])
        assert named.recv(100) == b"truth"
        link.close()


def test_frames_travel_together_but_never_in_pieces():
    with udp_socket() as client:
        link = UdpLink(("127.0.0.1", 0), client.getsockname(), "API link")
        frames = [bytes([number]) * 200 for number in range(20)]
        link.send(frames)
        datagrams = [client.recv(65535) for _ in range(3)]
        link.close()
    assert b"".join(datagrams) == b"".join(frames)
    assert all(len(datagram) % 200 == 0 for datagram in datagrams)


def test_a_free_port_is_taken_once():
    link = UdpLink(("127.0.0.1", 0), ("127.0.0.1", 9), "API link")
    with pytest.raises(PortInUseError, match="API link"):
        UdpLink(("127.0.0.1", link.port), ("127.0.0.1", 9), "API link")
    link.close()
