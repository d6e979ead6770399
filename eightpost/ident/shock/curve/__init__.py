"""The static curve: its design matrix, constraints on its shape, and its conversion to a shock file's curve."""
