"""Units for display of results."""

#: Display unit for each SI unit.
DISPLAY = {"m": "in", "m/s": "in/s", "N": "lbf", "N.m": "lbf.in", "m/s2": "g", "rad": "deg"}
