"""Corners of a car."""

#: The four corners in the order of every matrix, table and file: left front, right front, left rear, right rear.
CORNERS = ("lf", "rf", "lr", "rr")
