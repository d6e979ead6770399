"""Report kit: pages, plots, tables and numbers for people, without knowledge of what they are about.

Only this package imports plotly, jinja2, matplotlib and rich's tables. Its modules: `page` (interactive pages),
`charts` (their plots), `packing` (their numbers), `static` (pages without scripts), `pictures` (plots in image files),
`tables` (tables of results), `console` (tables in a terminal) and `numbers` (numbers as text, display units).
"""
