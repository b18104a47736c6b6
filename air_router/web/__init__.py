"""Map pages in the browser: the server, its guard against others' pages, and what pages share."""
