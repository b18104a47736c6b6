# What `air_router.report` gives, for type checkers; `__init__.py` says where it is.

from air_router.report.figure_style import Ink as Ink
from air_router.report.flight_history import FlightHistory as FlightHistory
from air_router.report.flight_history import history_of as history_of
from air_router.report.flight_page import page_of as page_of
from air_router.report.flight_table import several as several
from air_router.report.flight_table import table as table
from air_router.report.flight_table import went_on_without as went_on_without
from air_router.report.map_sheet import MapSheet as MapSheet
from air_router.report.picture import draw_coverage as draw_coverage
from air_router.report.picture import draw_mission as draw_mission
