"""The force that a fit predicts: curve, gas and the dynamics of a law, as a function of all parameters."""
