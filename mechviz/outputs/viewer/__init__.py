"""The browser view of a solved scene, served on this machine only.

with Viewer(run, port=0) as viewer:      # or serve(run), which blocks until Ctrl-C
    print(viewer.url)
    viewer.set_frame(90)
"""

from mechviz.outputs.viewer.app import Viewer, serve, serve_while
from mechviz.outputs.viewer.server import ViewerError

__all__ = ["Viewer", "ViewerError", "serve", "serve_while"]
