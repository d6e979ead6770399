"""What calls an FMU: each module is one probe, run by `python -m builder.check.probes <module> <folder> <progress>`.

They call the C functions themselves, because a wrong call must reach the FMU. Nothing that takes long to load is
imported: every probe is a process.
"""
