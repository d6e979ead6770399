"""What the machine needs of a study: its FMUs as matrices and parameters, its runs, and its measures."""
