"""Units in which results are shown."""

#: SI unit -> what a race engineer reads on an axis.
DISPLAY = {"m": "in", "m/s": "in/s", "N": "lbf", "N.m": "lbf.in", "m/s2": "g", "rad": "deg"}
