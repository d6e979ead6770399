"""The documents in an FMU archive: everything besides binaries, sources and modelDescription.xml."""
