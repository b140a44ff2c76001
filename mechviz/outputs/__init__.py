"""Where a picture and the catalogue go: recordings, the viewer, pages, images, files, notebooks."""
