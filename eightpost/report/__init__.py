"""Report kit: pages, plots, tables and numbers for people, without knowledge of what they are about.

Only the modules of this package import plotly, jinja2, matplotlib and rich's tables: `page` (HTML pages), `charts`
(interactive plots), `tables`, `packing` (arrays in a page), `numbers` (numbers as text), `pictures` (plots in image
files) and `console` (tables in a terminal).
"""
