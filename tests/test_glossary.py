"""The glossary of the pages: each page explains the words that it shows, and no others."""

import re

from eightpost.report.page import Section, document, explained, glossary
from eightpost.verdict import Verdict


def test_a_page_explains_the_words_that_it_contains_and_no_others():
    html = document("Curves", Verdict(), [Section("one", "One", ["a <b> Pareto front & its knees, RMS"])])
    words = html[html.index('class="words"') : html.index("<footer")]
    assert re.findall("<dt>(.*?)</dt>", words) == ["knee", "Pareto front", "RMS"]
    assert '<a href="#words">' in html


def test_words_are_found_in_any_spelling_and_not_inside_others_or_in_tags():
    assert list(explained("<p title='lag'>Coherent errors flag the FMUs</p>")) == ["coherence", "FMU"]
    assert list(explained("<style>knee</style><p>hysteresis, hysterical</p>")) == ["hysteresis"]
    assert explained("<p>a run of the setup</p>") == {}  # common words
    assert list(explained("<p>today the law Hysteresis</p>")) == ["baseline", "hysteresis", "Hysteresis"]


def test_every_word_has_a_short_definition_without_a_full_stop():
    words = glossary(common=True)
    assert len(words) > len(glossary()) > 40
    assert [word for word, text in words.items() if not 10 <= len(text) <= 130 or text.endswith(".")] == []
