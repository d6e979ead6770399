"""From a study to its rows: every setup through the real FMUs, on all cores, stopped and gone on with anywhere."""
