"""The verbs of the command line: their options and help texts. Importing them loads no numerical library."""
