"""Native FMUs: C sources with generated tables and constants, compiled for every platform."""
