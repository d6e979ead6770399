"""What a fit says: parameters, warnings, shock file, tables and plots."""
