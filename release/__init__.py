"""Checks before a release; none of them changes or uploads anything."""
