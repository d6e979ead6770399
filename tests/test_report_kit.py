"""The report kit shows texts as they are and amounts in the units of the reader."""

import io
import re

from markupsafe import Markup
from rich.console import Console

from eightpost.report.numbers import Display
from eightpost.report.page import Section, document, soft
from eightpost.report.static import Picture, static_page
from eightpost.report.tables import Amount, ResultTable, result_table
from eightpost.verdict import Verdict

NASTY = "</script><b>[bold]"
TABLE = ResultTable.of("forces", ["record", "RMS [N]", "unit"], [(NASTY, 4.4482216, "m/s"), ("b", None, "s")])


def test_texts_of_a_document_are_escaped_and_html_is_not():
    blocks = [NASTY, (NASTY,), soft(NASTY), TABLE, Markup("<p>a <em>word</em></p>")]
    html = document(NASTY, Verdict(), [Section("one", NASTY, blocks)], lead=NASTY)
    assert "<b>" not in html
    assert html.count("&lt;b&gt;[bold]") == 9  # title twice, lead, link, heading, paragraph, list, soft text, cell
    assert "<em>word</em>" in html


def test_a_table_of_a_page_has_both_unit_systems():
    html = document("t", Verdict(), [Section("one", "One", [TABLE])])
    assert '<th class="number">RMS [<span class="us">lbf</span><span class="si">N</span>]</th>' in html
    assert '<td class="number"><span class="us">1.00</span><span class="si">4.45</span></td>' in html
    assert '<td><span class="us">in/s</span><span class="si">m/s</span></td>' in html


def test_a_table_in_a_terminal_has_us_customary_units():
    console = Console(file=io.StringIO(), width=80)
    console.print(result_table(TABLE))
    shown = console.file.getvalue()
    assert all(text in shown for text in (NASTY, "RMS, lbf", "1.00", "in/s", "–"))


def test_a_unit_that_nobody_knows_is_shown_unchanged_and_a_density_is_squared():
    assert Display.of("smiles").unit == "smiles"
    density = Display.of("N2/Hz")
    assert (density.unit, density.factor) == ("lbf2/Hz", Display.of("N").factor ** 2)
    assert Display.of("m/s").squared == ("(in/s)²", "(m/s)²")
    assert Amount(1.0, "N").digits == 3


def test_a_page_without_scripts_escapes_its_texts():
    html = static_page(NASTY, NASTY, NASTY, [("a", NASTY)], Picture(b"", NASTY), "<p>body</p>")
    assert not re.search("<b>|<script", html)
    assert "<p>body</p>" in html
