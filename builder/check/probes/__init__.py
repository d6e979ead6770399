"""Probes that call an FMU; `__main__` runs those of several groups in one process.

Probes call the C functions directly, because an invalid call must reach the FMU. They import no slow modules, because
they run in processes of their own.
"""
