"""The verbs of the command line: their options and help texts, which load nothing that computes."""
