"""Outputs of a picture and its catalogue: recordings, the viewer, pages, images, files, notebooks."""
