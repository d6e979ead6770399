"""HTML pages in one file that needs no network: style, scripts, packed series and the plotting library are in it."""

from __future__ import annotations

import base64
import gzip
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cache
from html import unescape
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from eightpost import __version__
from eightpost import cache as disk
from eightpost.array_types import Array
from eightpost.extras import needs
from eightpost.files import write_text
from eightpost.report import tables
from eightpost.report.charts import Figure, Series
from eightpost.report.tables import Display, ResultTable
from eightpost.units import shown_system
from eightpost.verdict import Verdict

# ---- Glossary: each page explains the words that it contains, and docs/reference/glossary.md all --------------------

#: Comment of glossary.txt after which words are too common to be explained on every page.
_COMMON = "# Common words"


@cache
def glossary(*, common: bool = False) -> dict[str, str]:
    """Return the definitions of glossary.txt by word, with common words or without; spellings have ` | ` between."""
    text = files("eightpost.report").joinpath("glossary.txt").read_text(encoding="utf-8")
    lines = (text if common else text.partition(_COMMON)[0]).splitlines()
    pairs = (line.partition(": ") for line in lines if line and not line.startswith("#"))
    return {word: text for word, _, text in sorted(pairs, key=lambda pair: pair[0].lower())}


def explained(html: str) -> dict[str, str]:
    """Return the definitions of the words that the text of a page contains, in alphabetical order."""
    text = unescape(re.sub(r"<style>.*?</style>|<[^>]*>", " ", html, flags=re.DOTALL))
    return {word.split(" | ")[0]: meaning for word, meaning in glossary().items() if _pattern(word).search(text)}


@cache
def _pattern(word: str) -> re.Pattern[str]:
    """Return a pattern of the spellings of a word; words of capitals and names must be written as they are."""
    spellings = "|".join(re.escape(one) for one in word.split(" | "))
    return re.compile(rf"\b(?:{spellings})s?\b", re.IGNORECASE if word[0].islower() else 0)


with needs("report", "writing pages"):
    import jinja2
    from markupsafe import Markup
    from plotly.offline import get_plotlyjs

# ---- The page shell -------------------------------------------------------------------------------------------------

_KIT = "eightpost.report"

#: Place of the glossary in shell.html.
_WORDS = "<!-- words -->"

_FILTERS = {
    "figure": tables.figure,
    "fixed": tables.fixed,
    "percent": tables.percent,
    "listed": tables.listed,
    "cell": tables.cell_html,
    "unit": tables.unit_html,
    "caption": tables.caption_html,
}


def page(package: str, scripts: Sequence[str], /, name: str = "page", **context: Any) -> str:
    """Return the HTML of a package's template, which extends the kit's shell.html. All values are escaped.

    Args:
        package: Package with the files of the page.
        scripts: Script files of the package in the order of their dependencies; they follow the kit's shell.js.
        name: Path of the template and of its style, which follows the kit's shell.css, without the suffix.
        context: Values of the template: at least `title`, `verdict`, `places` (identifier and heading of each section)
            and `data` (identifier and text of each script element with data). An undefined name is an error. `words`
            are definitions in addition to those of the glossary.
    """
    loaders = [jinja2.PackageLoader(package, "."), jinja2.PackageLoader(_KIT, "templates")]
    environment = jinja2.Environment(
        bytecode_cache=_Compiled(),
        loader=jinja2.ChoiceLoader(loaders),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= _FILTERS
    own = [_file(package, script) for script in scripts]
    html = environment.get_template(f"{name}.html").render(
        {
            "style": _file(_KIT, "templates/shell.css") + _file(package, f"{name}.css"),
            "script": Markup("\n").join([_file(_KIT, "templates/shell.js"), *own]),
            "plotly": _plotly(),
            "version": __version__,
            "is_metric": shown_system() == "si",
            "written": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        }
        | context
    )
    words = explained(html.partition("<script")[0]) | context.get("words", {})
    return html.replace(_WORDS, environment.get_template("words.html").render(words=words), 1)


def write_page(path: str | Path, content: str) -> Path:
    """Write a page; an existing file is replaced only when the new one is complete. Return the path."""
    return write_text(path, content)


def compressed(content: bytes) -> str:
    """Return bytes compressed with gzip and encoded in base64, whose characters cannot end a script element."""
    return base64.b64encode(gzip.compress(content, compresslevel=9, mtime=0)).decode("ascii")


@cache
def _plotly() -> str:
    """Return the plotting library, compressed; that takes long, so it is kept in the cache."""
    content = get_plotlyjs().encode()
    key = disk.digest([content])
    kept = disk.recall("pages", key)
    if kept is None:
        kept = compressed(content).encode()
        disk.keep("pages", key, kept)
    return kept.decode()


class _Compiled(jinja2.BytecodeCache):
    """Templates as compiled code in the cache."""

    def load_bytecode(self, bucket: jinja2.bccache.Bucket) -> None:
        if (code := disk.recall("pages", bucket.key)) is not None:
            bucket.bytecode_from_string(code)

    def dump_bytecode(self, bucket: jinja2.bccache.Bucket) -> None:
        disk.keep("pages", bucket.key, bucket.bytecode_to_string())


def _file(package: str, name: str) -> Markup:
    """Return a file of a package unchanged, for a style or a script element."""
    return Markup(files(package).joinpath(name).read_text(encoding="utf-8"))


# ---- A printable document of texts, tables and figures --------------------------------------------------------------

#: Content of a section: a paragraph, HTML (Markup), a list of texts, a table, or a figure.
Block = str | tuple[str, ...] | ResultTable | Figure


@dataclass(frozen=True, slots=True)
class Section:
    """A section of a document."""

    name: str  #: Identifier of the section on the page.
    heading: str  #: Heading of the section, which is also its link at the top of the page.
    blocks: Sequence[Block]  #: Contents in their order.
    folded: bool = False  #: Whether a reader unfolds it first; it is not printed unless it is unfolded.


def document(
    title: str,
    verdict: Verdict,
    sections: Sequence[Section],
    *,
    lead: str = "",
    fold: int | None = None,
    links: Mapping[str, str] | None = None,
) -> str:
    """Return the HTML of a document; all texts are escaped, except for Markup.

    Args:
        title: Heading of the page.
        verdict: Verdict at its top.
        sections: Sections in their order.
        lead: Text below the verdict; default none.
        fold: Number of reasons after which the list is folded; default: it is never folded. A folded list is not
            printed, so that the sections must contain it.
        links: Names of other pages by their paths relative to this one.
    """
    figures = [block for section in sections for block in section.blocks if isinstance(block, Figure)]
    shown = {unit: Display.us(unit) for figure in figures for unit in sorted(figure.units)}
    content = {
        "figures": [figure.content() for figure in figures],
        "units": {unit: [scale.factor, scale.unit] for unit, scale in shown.items()},
    }
    return page(
        _KIT,
        ["templates/document.js"],
        name="templates/document",
        title=title,
        verdict=verdict,
        lead=lead,
        fold=fold,
        places=[(section.name, section.heading) for section in sections if section.blocks],
        links=links or {},
        sections=[section for section in sections if section.blocks],
        data={"figures": compressed(json.dumps(content, allow_nan=False, separators=(",", ":")).encode())},
    )


def soft(text: str) -> Markup:
    """Return a paragraph in a soft colour."""
    return Markup('<p class="soft">{}</p>').format(text)


def digest(*texts: str) -> Markup:
    """Return digests in small letters, one below the other."""
    return Markup("<br>").join(Markup('<span class="digest">{}</span>').format(text) for text in texts)


# ==== Time series in a page: traces without loss of peaks, power spectral densities ==================================


# ---- Encoding of arrays as text in a page ---------------------------------------------------------------------------

#: Number of levels between the minimum and the maximum of a channel: 16 bits are 100 times finer than a screen.
LEVELS = 65535


@dataclass
class Store:
    """Arrays in one block of bytes, each identified by its start position."""

    _content: bytearray = field(default_factory=bytearray)

    def add(self, values: Array) -> int:
        """Add numbers in full (little-endian, 64 bits) and return their start position."""
        return self._append(values.astype("<f8").tobytes())

    def add_single(self, values: Array) -> int:
        """Add numbers to seven digits (little-endian, 32 bits) and return their start position."""
        return self._append(values.astype("<f4").tobytes())

    def add_levels(self, values: Array) -> int:
        """Add (M,) values as 16-bit levels between their minimum and maximum, and return their start position.

        Each level is stored as its difference from the one before, modulo 2^16: a smooth signal compresses well.
        """
        low, high = float(values.min()), float(values.max())
        levels = np.rint((values - low) * (LEVELS / (high - low))) if high > low else np.zeros_like(values)
        differences = np.diff(levels.astype("<u2"), prepend=np.uint16(0))
        return self._append(differences.astype("<u2").tobytes())

    @property
    def text(self) -> str:
        """Contents as text for a page."""
        return compressed(bytes(self._content))

    def _append(self, content: bytes) -> int:
        self._content.extend(b"\0" * (-len(self._content) % 8))  # a browser reads doubles at multiples of eight only
        place = len(self._content)
        self._content.extend(content)
        return place


# ---- Power spectral densities ---------------------------------------------------------------------------------------

#: Length of a block [s]: a resolution of 0.25 Hz, and 14 blocks, half overlapping, in 30 s.
BLOCK = 4.0

#: Maximum number of values over all channels of a page; blocks are shortened to stay below it.
CAPACITY = 1_000_000

#: Minimum number of samples for a spectrum.
_FEWEST = 16


@dataclass(frozen=True, slots=True, eq=False)
class Spectra:
    """One-sided power spectral densities."""

    frequency: Array  #: Frequencies (K,) above zero [Hz].
    density: Array  #: Densities (C, K) in the SI unit squared per Hz; the integral over frequency is the variance.
    block: float  #: Length of a block [s].
    duration: float  #: Length of the series [s].


def spectra(series: Series) -> Spectra | None:
    """Estimate densities by Welch's method: Hann blocks of 4 s, half overlapping, each without its mean.

    Blocks are shorter in a shorter series, and if there are so many channels that a page could not hold their
    densities. A series with uneven steps is interpolated to its median rate first.

    Returns:
        Densities; None if there are too few samples or no channels.
    """
    if len(series) < _FEWEST or not series.names:
        return None
    even = series if series.is_uniform else series.resample(series.sample_rate)
    rate = even.sample_rate
    length = min(len(even), round(BLOCK * rate), max(_FEWEST, 2 * CAPACITY // len(even.names)))
    if length < _FEWEST:
        return None
    frequency, density = welch(even.values, rate, length)
    return Spectra(frequency[1:], density[:, 1:], block=length / rate, duration=even.duration)


def welch(values: Array, rate: float, length: int) -> tuple[Array, Array]:
    """Return frequencies (K,) [Hz] and one-sided densities (..., K) of samples (..., N), by Welch's method.

    Hann blocks of `length` samples, half overlapping, each without its mean. They agree with those of scipy.signal to
    rounding, which takes most of a second to load.
    """
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(length) / length)
    blocks = np.lib.stride_tricks.sliding_window_view(values, length, axis=-1)[..., :: length - length // 2, :]
    lines = np.fft.rfft(window * (blocks - blocks.mean(axis=-1, keepdims=True)))
    density: Array = (np.abs(lines) ** 2).mean(axis=-2) / (rate * np.sum(window**2))
    density[..., 1 : (length + 1) // 2] *= 2.0
    return np.arange(length // 2 + 1, dtype=np.float64) * (rate / length), density


# ---- Decimation of time traces for a page, without loss of peaks ----------------------------------------------------

#: Maximum number of values over all channels of a page: 40 channels of 60 s at 2 ms fit, in about 3 MB.
TRACES_CAPACITY = 1_250_000


@dataclass(frozen=True, slots=True, eq=False)
class Traces:
    """Traces that the page draws."""

    time: Array  #: Times (M,) [s].
    values: Array  #: Values (C, M) in SI.
    samples: int  #: Number of recorded samples per pair of values; 1 if all are kept.
    interval: float  #: Time span of these samples [s].


def traces(series: Series, *, capacity: int = TRACES_CAPACITY) -> Traces:
    """Keep all samples if they fit, else the minimum and the maximum of every few, in their order.

    With n samples per pair, the times of each pair are those of the first and the middle of the n samples, so the time
    of a value is wrong by less than n samples.

    Args:
        series: Recorded series with C channels.
        capacity: Maximum number of values to keep, over all channels; at least two per channel are kept.
    """
    length, channels = len(series), max(1, len(series.names))
    pairs = max(1, capacity // (2 * channels))
    if length <= 2 * pairs:
        return Traces(series.time, series.values, samples=1, interval=series.duration / max(1, length - 1))
    samples = -(-length // pairs)
    starts = np.arange(0, length, samples)
    middles = np.minimum(starts + samples // 2, length - 1)
    time = series.time[np.column_stack([starts, middles]).ravel()]
    return Traces(time, _pairs(series.values, samples), samples, interval=samples * series.duration / (length - 1))


def _pairs(values: Array, samples: int) -> Array:
    """Return (C, 2 K): minimum and maximum of every `samples` values, in the order in which they occurred."""
    channels, length = values.shape
    missing = -length % samples
    bins = np.pad(values, ((0, 0), (0, missing)), mode="edge").reshape(channels, -1, samples)
    ends = np.sort(np.stack([bins.argmin(axis=2), bins.argmax(axis=2)], axis=2), axis=2)
    pairs: Array = np.take_along_axis(bins, ends, axis=2).reshape(channels, -1)
    return pairs
