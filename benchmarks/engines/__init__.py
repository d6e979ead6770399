"""The compared engines, one module each."""
