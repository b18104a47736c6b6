# The names of `sitl.experiment.campaign`, for type checkers; `__init__.py` has the module of each.

from sitl.experiment.campaign.campaign import Campaign as Campaign
from sitl.experiment.campaign.campaign import Work as Work
from sitl.experiment.campaign.campaign import make_runs as make_runs
from sitl.experiment.campaign.cluster import Cluster as Cluster
from sitl.experiment.campaign.cluster import cluster_at as cluster_at
from sitl.experiment.campaign.journal import Journal as Journal
from sitl.experiment.campaign.journal import StopClock as StopClock
from sitl.experiment.campaign.provenance import program as program
from sitl.experiment.campaign.remaking import Remade as Remade
from sitl.experiment.campaign.remaking import remade as remade
from sitl.experiment.campaign.remaking import remakeable as remakeable
from sitl.experiment.campaign.running import make_run as make_run
from sitl.experiment.campaign.running import put_together as put_together
from sitl.experiment.campaign.running import settings_of as settings_of
from sitl.experiment.campaign.runs import ARCHIVE_ENDING as ARCHIVE_ENDING
from sitl.experiment.campaign.runs import RunLog as RunLog
from sitl.experiment.campaign.runs import read_archive as read_archive
from sitl.experiment.campaign.runs import run_log as run_log
from sitl.experiment.campaign.runs import write_archive as write_archive
