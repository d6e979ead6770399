"""The command line: one file for each verb, with its options and its call. Help texts load no numerical library."""
