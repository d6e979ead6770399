"""Shock laws fitted to dynamometer tests (3.3), and how well they predict (3.4). eightpost.ident has the names."""
