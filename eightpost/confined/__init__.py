"""Reading with libraries that a damaged file can crash: in a process of its own, with limits of time and memory.

A crash there becomes an error that names the file. The process starts with the first such file and stays for the next
ones, so that the start is paid once.
"""

from eightpost.confined.process import read_confined

__all__ = ["read_confined"]
