"""Recipe grey-box (8.2): a physical car whose parameters are fitted to the outputs of a free-running simulation.

Optional: nothing else imports this package; the table of recipes loads it when the recipe is requested.
"""
