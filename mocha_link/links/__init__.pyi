# What `mocha_link.links` gives, for type checkers; `__init__.py` has the module of each.

from mocha_link.links.link_table import QUIET_CONTACT_S as QUIET_CONTACT_S
from mocha_link.links.link_table import LinkTable as LinkTable
from mocha_link.links.link_table import throughput_bytes_s as throughput_bytes_s
from mocha_link.links.metrics import Contact as Contact
from mocha_link.links.metrics import ContactBegan as ContactBegan
from mocha_link.links.metrics import ContactEnded as ContactEnded
from mocha_link.links.metrics import Direction as Direction
from mocha_link.links.metrics import LinkEvent as LinkEvent
from mocha_link.links.metrics import LinkMetrics as LinkMetrics
from mocha_link.links.metrics import LinkState as LinkState
from mocha_link.links.metrics import MessageStored as MessageStored
from mocha_link.links.metrics import RssiChanged as RssiChanged
from mocha_link.links.metrics import StorageFailed as StorageFailed
from mocha_link.links.metrics import StorageRecovered as StorageRecovered
from mocha_link.links.metrics import SyncEnded as SyncEnded
from mocha_link.links.metrics import SyncStarted as SyncStarted
from mocha_link.links.metrics import SyncTimedOut as SyncTimedOut
from mocha_link.links.reading import Reading as Reading
from mocha_link.links.reading import Unit as Unit
from mocha_link.links.reading import as_reading as as_reading
from mocha_link.links.trigger import NO_SIGNAL as NO_SIGNAL
from mocha_link.links.trigger import SILENT_INTERVALS as SILENT_INTERVALS
from mocha_link.links.trigger import SyncTrigger as SyncTrigger
from mocha_link.links.trigger import threshold as threshold
