"""A dynamometer record with what it is: its kind, its configuration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from eightpost.ident.shock.report.description import digest_of
from eightpost.ident.validation.configuration import (
    checked,
    conditions_of_test,
    configuration_of,
    configuration_of_file,
)
from eightpost.ident.validation.kinds import recognise

if TYPE_CHECKING:
    from collections.abc import Mapping
    from typing import Any

    from eightpost.ident.validation.kinds import Kind
    from eightpost.rig.dyno_test import DynoTest


@dataclass(frozen=True, slots=True, eq=False)
class Record:
    """A record to validate on.

    Attributes:
        name: For people.
        test: What was measured.
        kind: What test it is.
        reason: How that is known.
        configuration: 1 to 12 of Table 3.1; None where not known.
        frequency: Of a sine [Hz], where it was recognised.
        digest: SHA-256 of the file, or of the samples.
    """

    name: str
    test: DynoTest
    kind: Kind
    reason: str
    configuration: int | None
    frequency: float | None
    digest: str

    @property
    def conditions(self) -> Mapping[str, Any]:
        """What is known of the shock in it, under the names of a shock file."""
        said = conditions_of_test(self.test)
        return said | {"configuration": self.configuration} if self.configuration else said


def record_of(
    test: DynoTest, *, name: str | None = None, kind: Kind | None = None, configuration: int | None = None
) -> Record:
    """Return a record, its kind recognised where it is not told.

    Args:
        test: What was measured.
        name: Default the file's.
        kind: Goes before what is recognised.
        configuration: Goes before what the conditions and the note in the file say.

    Raises:
        ParameterError: The configuration is none of the twelve.
    """
    known = _stated(test) if configuration is None else checked(configuration)
    seen = recognise(test) if kind is None else None
    return Record(
        name=name or (test.source.stem if test.source else "record"),
        test=test,
        kind=seen.kind if seen else kind or "random",
        reason=seen.reason if seen else "as told",
        configuration=known,
        frequency=seen.frequency if seen else None,
        digest=digest_of(test),
    )


def _stated(test: DynoTest) -> int | None:
    known = configuration_of(conditions_of_test(test))
    return configuration_of_file(test.source) if known is None and test.source and test.source.is_file() else known
