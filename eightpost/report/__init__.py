"""Report kit: pages, plots, tables and numbers for people, without knowledge of what they are about.

Only this package imports plotly, jinja2, matplotlib and rich's tables. Its modules: `page` (interactive pages and
their packed series), `charts` (their plots), `static` (pages without scripts), `pictures` (plots in image files),
`tables` (numbers as text, display units, tables of results) and `console` (tables in a terminal).
"""
