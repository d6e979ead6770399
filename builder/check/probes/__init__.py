"""Probes that call an FMU. `python -m builder.check.probes <module>.<probe> <folder> <progress>` runs one probe.

Probes call the C functions directly, because an invalid call must reach the FMU. They import no slow modules, because
every probe is a process.
"""
