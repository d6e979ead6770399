"""Colours of the builds of a bank."""

from __future__ import annotations

from colorsys import hls_to_rgb

from cosim.report.channels import COLORS

_GOLDEN = 0.618034


def build_colors(count: int) -> tuple[str, ...]:
    """Return distinct colours: first those of the run's page, then hues that are far from each other."""
    more = (hls_to_rgb(_GOLDEN * k % 1.0, 0.35 + 0.15 * (k % 3), 0.6) for k in range(count - len(COLORS)))
    return (*COLORS[:count], *("#" + "".join(f"{round(255 * part):02x}" for part in rgb) for rgb in more))
