"""What the tests of all chapters need: plots that are not drawn, and the claims of findings."""

import pytest


@pytest.fixture(autouse=True)
def plots(request, monkeypatch):
    """Panels of the figures of the module's chapter, which are not drawn."""
    drawn = []
    if hasattr(request.module, "chapter"):
        monkeypatch.setattr(request.module.chapter, "figure_of", lambda _caption, panels, **_: drawn.extend(panels))
    return drawn


def claims(findings):
    """Return by name whether a claim holds."""
    return {name: holds for name, (holds, _) in findings.claims.items()}
