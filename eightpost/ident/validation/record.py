"""A dynamometer record with its kind and its configuration."""

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
    """A record for validation.

    Attributes:
        name: Display name.
        test: Measured test.
        kind: Kind of the test.
        reason: Reason for the kind.
        configuration: Configuration 1 to 12 of Table 3.1; None if unknown.
        frequency: Frequency of a sine [Hz], if it was recognised as one.
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
        """The known conditions of the shock in the record, under the names of a shock file."""
        stated = conditions_of_test(self.test)
        return stated | {"configuration": self.configuration} if self.configuration else stated


def record_of(
    test: DynoTest, *, name: str | None = None, kind: Kind | None = None, configuration: int | None = None
) -> Record:
    """Return a record; its kind is recognised if it is not given.

    Args:
        test: Measured test.
        name: Display name; default the file's name.
        kind: Kind of the test, which replaces the recognised one.
        configuration: Configuration, which replaces that of the conditions and of a note in the file.

    Raises:
        ParameterError: The configuration is not a number from 1 to 12.
    """
    known = _stated(test) if configuration is None else checked(configuration)
    seen = recognise(test) if kind is None else None
    return Record(
        name=name or (test.source.stem if test.source else "record"),
        test=test,
        kind=seen.kind if seen else kind or "random",
        reason=seen.reason if seen else "given by the user",
        configuration=known,
        frequency=seen.frequency if seen else None,
        digest=digest_of(test),
    )


def _stated(test: DynoTest) -> int | None:
    known = configuration_of(conditions_of_test(test))
    return configuration_of_file(test.source) if known is None and test.source and test.source.is_file() else known
