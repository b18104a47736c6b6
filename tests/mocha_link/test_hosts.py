"""Addresses as text, and as sockets take them."""

import socket

import pytest

from mocha_link.hosts import (
    as_host,
    host_of,
    is_number,
    joined,
    socket_address,
)

LO = socket.if_nametoindex("lo")


@pytest.mark.parametrize(
    ("text", "host"),
    [
        ("titan.local", "titan.local"),
        ("192.168.1.13", "192.168.1.13"),
        ("[::1]", "::1"),
        ("FD00:0:0::0013", "fd00::13"),
        ("fe80::1%wlan0", "fe80::1%wlan0"),
        ("[fe80::1%eth0.4]", "fe80::1%eth0.4"),
        ("::ffff:10.0.0.4", "10.0.0.4"),
    ],
)
def test_a_host_has_one_form(text, host):
    assert as_host(text) == host
    assert as_host(host) == host


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("titan:24300", "has a port; write 'titan'"),
        ("[fe80::1%wlan0]:5551", "write 'fe80::1%wlan0'"),
        ("fe80::1", "write the interface behind it, 'fe80::1%wlan0'"),
        ("fe80::1%a/b", "no host name and no address"),
        ("fe80::1%" + "x" * 16, "no host name and no address"),
        ("[::1", "no host name"),
        ("::1::", "no IPv6 address"),
        ("", "no host name"),
        ("a b", "no host name"),
    ],
)
def test_the_error_of_an_invalid_host_has_what_to_write(text, why):
    with pytest.raises(ValueError, match=r"is |has ") as error:
        as_host(text)
    assert why in str(error.value)


def test_numbers_are_distinguished_from_names():
    assert [is_number(each) for each in ("::1", "10.0.0.4", "titan", "10.0.0", "1.2.3.4.")] == [
        *(True, True),
        *(False, False, False),
    ]


@pytest.mark.parametrize("host", ["10.0.0.4", "fd00::4", "fe80::4%lo"])
def test_what_a_socket_reports_is_the_host_again(host):
    assert host_of(socket_address(host, 5551)) == host
    assert host_of(socket_address(host, 5551, mapped=True)) == host


def test_a_link_local_address_goes_by_its_interface():
    assert socket_address("fe80::4%lo", 1) == ("fe80::4", 1, 0, LO)
    assert socket_address(f"fe80::4%{LO}", 1) == ("fe80::4", 1, 0, LO)
    with pytest.raises(OSError, match=r"interface|device"):
        socket_address("fe80::4%nowhere", 1)


def test_host_and_port_in_one_text():
    assert joined("fe80::1%wlan0", 5551) == "[fe80::1%wlan0]:5551"
    assert joined("titan", 5551) == "titan:5551"
