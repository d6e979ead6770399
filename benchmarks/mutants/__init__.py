"""Mutation testing: a source is changed in one place, and the tests of its area must fail."""
