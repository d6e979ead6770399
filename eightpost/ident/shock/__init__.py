"""Fitting of shock laws to dynamometer tests (3.3) and their validation (3.4). eightpost.ident exports the names."""
