"""The predicted force of a fit (curve, gas force and a law's dynamics) as a function of all parameters."""
