"""Checks of records of dynamometers and rigs: faults, and the tables of rules that they break."""

from eightpost.checks.fault import Fault

__all__ = ["Fault"]
