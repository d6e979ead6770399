"""The static curve: as a sum of columns, as the shape that it may have, as what a shock file holds."""
