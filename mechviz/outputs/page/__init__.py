"""Sharing without a server: pages that play a mechanism, pictures and films of them.

make_page(Recording("crank-rocker.rrd"))[0]  # the text of one HTML file
"""

from mechviz.outputs.page.page import make_page

__all__ = ["make_page"]
