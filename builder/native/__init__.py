"""The native FMU: C sources with an FMU's tables and constants, compiled for every platform."""
