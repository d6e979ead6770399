"""Many setups at once: a library, compiled from the C sources of the FMUs, that runs one setup in each lane."""
