# What `air_router.web` gives, for type checkers; `__init__.py` says where it is.

from air_router.web.guard import cookie_of as cookie_of
from air_router.web.outlines import Degrees as Degrees
from air_router.web.outlines import Rings as Rings
from air_router.web.outlines import area_beside as area_beside
from air_router.web.outlines import beside as beside
from air_router.web.outlines import buffer as buffer
from air_router.web.outlines import degrees as degrees
from air_router.web.outlines import line as line
from air_router.web.outlines import place_in as place_in
from air_router.web.serving import HERE as HERE
from air_router.web.serving import SHOWN_AT as SHOWN_AT
from air_router.web.serving import PageAddress as PageAddress
from air_router.web.serving import Say as Say
from air_router.web.serving import Served as Served
from air_router.web.serving import ServeError as ServeError
from air_router.web.serving import Web as Web
from air_router.web.serving import page_options as page_options
from air_router.web.serving import page_port as page_port
from air_router.web.serving import show as show
from air_router.web.serving import shown_beside as shown_beside
from air_router.web.serving import web_of as web_of
from air_router.web.serving import web_options as web_options
from air_router.web.site import Browsers as Browsers
from air_router.web.site import PageOutbox as PageOutbox
from air_router.web.site import Site as Site
from air_router.web.site import as_json as as_json
