"""Components of a system: FMUs in this process or in one of their own, their files, functions, messages and units."""
