"""Damaged files for every reader: each must be read, or refused with a message that names the file.

python -m benchmarks.fuzz --mutants 6000 --seed 1
"""
