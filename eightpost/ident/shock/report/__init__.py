"""The report of a fit: parameters, warnings, shock file, tables and plots."""
