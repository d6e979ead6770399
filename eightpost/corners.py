"""Corners of a car and the names of their channels."""

#: The four corners in the order of every matrix, table and file: left front, right front, left rear, right rear.
CORNERS = ("lf", "rf", "lr", "rr")


def channel(corner: str, quantity: str) -> str:
    """Return the name of a corner's channel: `lf.force`, or `force` for a quarter car, whose corner has no name."""
    return f"{corner}.{quantity}" if corner else quantity
