"""The dynamics of the laws: in closed form, or by the law's own functions, compiled and stepped."""
