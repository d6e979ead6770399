"""Validation campaign for the stated coupling error: `python -m benchmarks.honesty --help`.

Random systems (`cases`) are run by the product (`runs`) and compared with an independent solution of the whole system
as one set of differential equations (`reference`).
"""
