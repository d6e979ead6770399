"""Which tools run which of the four interface kinds: FMI 2.0 and 3.0, co-simulation and model exchange."""
