"""FMI 2.0 and 3.0 for the co-simulation and the check: modelDescription.xml as written, and names of functions."""
