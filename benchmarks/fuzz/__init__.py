"""Fuzz tests with damaged files for every reader: each must be read, or rejected with a message that names the file.

python -m benchmarks.fuzz --mutants 6000 --seed 1
"""
