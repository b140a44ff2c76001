"""mechviz: a desktop-free 3D inspector and recorder of mechanisms."""
