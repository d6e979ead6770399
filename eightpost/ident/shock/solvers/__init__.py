"""The solvers of the fit: joint or step by step, with outliers, choice of the order, and uncertainty."""
