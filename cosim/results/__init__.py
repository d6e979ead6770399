"""What a run gives: signals, coupling errors, ranges of the models, and the verdict on all of it."""
