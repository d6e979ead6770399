"""Plugin that builds native FMUs for this platform only, which is a sixth of the work."""

from __future__ import annotations

from builder.native.platforms import PLATFORMS, this_platform
from builder.native.toolchain import Zig

if this_platform().name in PLATFORMS:
    Zig.platforms = (this_platform(),)  # type: ignore[assignment,misc]
