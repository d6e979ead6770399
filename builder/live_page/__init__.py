"""A page on which a shock and a quarter car with it run live: the C code of their FMUs as WebAssembly."""

from builder.live_page.live_page import LivePage, write_live_page

__all__ = ["LivePage", "write_live_page"]
