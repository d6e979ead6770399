"""The verbs of the command line, one file each: they say what was read, decided and written."""
