"""Addresses of peers: static, host names, mDNS, and sources of incoming connections."""

from mocha_link.addresses.address_book import AddressBook
from mocha_link.addresses.mdns import Mdns
from mocha_link.addresses.own_addresses import OwnAddresses
from mocha_link.addresses.resolver import Resolver

__all__ = ["AddressBook", "Mdns", "OwnAddresses", "Resolver"]
