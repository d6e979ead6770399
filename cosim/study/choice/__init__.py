"""Choice of setups from a study's table: sensitivity, robustness, selection, comparison with the rig, search."""
