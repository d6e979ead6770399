"""The dynamics of the laws in the fit: in closed form, or by stepping the law's own compiled functions."""
