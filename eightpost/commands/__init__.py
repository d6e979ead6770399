"""The verbs of the command line, one file each: they do the work and print what was read, decided and written."""
