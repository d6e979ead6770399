"""The documentation site is built without a warning, loads nothing from a network, and all its links lead somewhere."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from dataclasses import dataclass, field
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

pytestmark = pytest.mark.nightly

ROOT = Path(__file__).resolve().parents[2]

#: Attributes by which a page loads something, unlike the links that a reader may follow.
LOADS = {
    "script": "src",
    "img": "src",
    "iframe": "src",
    "source": "src",
    "video": "src",
    "audio": "src",
    "link": "href",
}
#: Kinds of <link> that load nothing.
RELATIONS = {"canonical", "next", "prev", "search", "index", "author", "top"}


@dataclass
class Parsed(HTMLParser):
    """What a page loads, where its links lead, and the names of its places."""

    loads: list[str] = field(default_factory=list)
    links: list[str] = field(default_factory=list)
    places: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        super().__init__()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = {name: value or "" for name, value in attrs}
        self.places |= {found[name] for name in ("id", "name") if name in found}
        if tag == "a" and "href" in found:
            self.links.append(found["href"])
        if (name := LOADS.get(tag)) in found and not (tag == "link" and found.get("rel") in RELATIONS):
            self.loads.append(found[name])


def parse(page: Path) -> Parsed:
    parsed = Parsed()
    parsed.feed(page.read_text(encoding="utf-8"))
    return parsed


#: The build keeps millions of objects until its end, among which Python would look for garbage all the time.
BUILD = "import gc, sys; gc.set_threshold(200_000, 20); from sphinx.cmd.build import main; sys.exit(main(sys.argv[1:]))"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    command = [
        sys.executable, "-c", BUILD, "--fail-on-warning", "--keep-going", "--quiet",
        "-d", str(folder / "doctrees"), "-c", "docs", ".", str(folder / "html"),
    ]  # fmt: skip
    # A proxy that nobody answers: a build that needs a network fails.
    environment = os.environ | dict.fromkeys(("http_proxy", "https_proxy"), "http://127.0.0.1:9")
    built = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    return folder / "html"


@pytest.fixture(scope="module")
def parsed(site: Path) -> dict[Path, Parsed]:
    return {page: parse(page) for page in sorted(site.rglob("*.html")) if "_static" not in page.parts}


def test_every_page_of_the_folder_is_a_page_of_the_site(site):
    """Pages that no list of contents names are warnings, so that the build fails."""
    sources = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md"), *(ROOT / "fmus").glob("*/README.md")]
    missing = [path for path in sources if not (site / path.relative_to(ROOT)).with_suffix(".html").is_file()]
    assert missing == []


def test_no_page_loads_anything_from_a_network(parsed):
    loaded = {url for page in parsed.values() for url in page.loads if urlsplit(url).scheme not in ("", "data")}
    assert loaded == set()
    assert sum(len(page.loads) for page in parsed.values()) > 500


def test_no_style_loads_anything_from_a_network(site):
    styles = sorted(site.rglob("*.css"))
    assert styles
    for style in styles:
        text = style.read_text(encoding="utf-8")
        assert not re.findall(r"(?:@import|url\()\s*['\"]?(?:https?:)?//", text), style.name


def test_every_link_and_anchor_of_the_site_leads_somewhere(site, parsed):
    broken = []
    for page, content in parsed.items():
        for link in [*content.links, *content.loads]:
            parts = urlsplit(link)
            if parts.scheme:
                continue
            target = (page.parent / unquote(parts.path)).resolve() if parts.path else page
            target = target / "index.html" if target.is_dir() else target
            anchor = unquote(parts.fragment)
            if not target.is_file() or (anchor and target in parsed and anchor not in parsed[target].places):
                broken.append(f"{page.relative_to(site)}: {link}")
    assert broken == []


def test_equations_are_mathml(site):
    text = (site / "fmus" / "shock_lpnl2" / "README.html").read_text(encoding="utf-8")
    assert text.count('<math display="block"') >= 5
    assert "\\frac" not in re.sub(r"<annotation.*?</annotation>", "", text)


def test_the_reference_has_the_public_names_with_their_arguments(site):
    text = (site / "docs" / "reference" / "api" / "cosim.html").read_text(encoding="utf-8")
    for name in ("cosim.run", "cosim.System", "cosim.Result.verdict", "cosim.ForceLaw.force"):
        assert f'id="{name}"' in text, name
    assert "Parameters" in text and "Raises" in text


def test_a_page_states_what_it_loads_and_where_its_links_lead(tmp_path):
    (tmp_path / "page.html").write_text(
        '<link rel="stylesheet" href="a.css"><link rel="next" href="b.html"><script src="https://x.org/c.js"></script>'
        '<h1 id="top">T</h1><a href="b.html#end">b</a>'
    )
    found = parse(tmp_path / "page.html")
    assert (found.loads, found.links, found.places) == (["a.css", "https://x.org/c.js"], ["b.html#end"], {"top"})
