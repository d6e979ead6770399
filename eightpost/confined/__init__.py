"""Reading of files in a separate process with time and memory limits, for libraries that a damaged file can crash.

A crash of the process becomes an error that names the file. The process starts with the first such file and reads the
later ones too, so that the libraries are loaded only once.
"""

from eightpost.confined.process import read_confined

__all__ = ["read_confined"]
