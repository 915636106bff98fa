"""Interactive pages from result files alone."""

from ancf2d.view.page import Page, make_page, serve

__all__ = ["Page", "make_page", "serve"]
