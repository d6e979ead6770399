"""Records that models are validated on, and the kinds of tests that they contain."""

from dataclasses import dataclass
from typing import Literal

Kind = Literal["random", "sine", "static", "bump"]

#: Share of the time at standstill from which a record is a static test or a bump.
STANDING = 0.5


@dataclass(frozen=True, slots=True)
class Recognition:
    """Kind of a record, with the reason for it.

    Attributes:
        kind: `random` (track records too), `sine`, `static` or `bump`.
        reason: Property of the motion or of the drive that led to this kind.
        frequency: Frequency of a sine [Hz]; None for the other kinds.
    """

    kind: Kind
    reason: str
    frequency: float | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Record:
    """A record for validation.

    Attributes:
        name: Display name.
        kind: Kind of the test.
        reason: Reason for the kind.
        frequency: Frequency of a sine [Hz], if it was recognised as one.
        digest: SHA-256 of the file, or of the samples; empty without one.
    """

    name: str
    kind: Kind
    reason: str
    frequency: float | None = None
    digest: str
