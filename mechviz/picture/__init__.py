"""The picture of a run or of its recording: a flat list of nodes, which every output takes."""

from mechviz.picture.build import bare_picture, picture_of
from mechviz.picture.nodes import Arc, Arrow, Body, Lines, Mesh, Node, Picture, Points, Poses

__all__ = ["Arc", "Arrow", "Body", "Lines", "Mesh", "Node", "Picture", "Points", "Poses", "bare_picture", "picture_of"]
