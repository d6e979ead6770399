"""Modules that pytest loads before the tests of a trial."""
