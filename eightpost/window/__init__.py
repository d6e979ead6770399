"""A window in the browser, on this machine only: `eightpost app` (docs/how_to/app.md).

Every action is a command in a process of its own, which writes the files that the terminal would write; every number
comes from these files.
"""
