"""API for notebooks: `import eightpost as ep` gives these functions.

docs/reference/api/eightpost.md lists them. Libraries load when they are called.

Each function calls what the verb of the same name calls, takes paths or objects, and returns a result that states
itself in a few lines, converts to pandas and xarray, and draws itself.
"""
