"""The documents in an FMU archive: everything besides binaries, sources and modelDescription.xml."""

from builder.documents.archive import documents
from builder.documents.reference import SECRET, Disclosure, Subject

__all__ = ["SECRET", "Disclosure", "Subject", "documents"]
