"""Execution of a study: every setup runs through the real FMUs on all cores and can be stopped and resumed."""
