"""The picture of a run or of its recording: a flat list of nodes, from which every output draws."""

from mechviz.picture.build import bare_picture, picture_of
from mechviz.picture.nodes import Arrow, Body, Lines, Mesh, MomentArc, Node, Picture, Points, PoseTrack

__all__ = ["Arrow", "Body", "Lines", "Mesh", "MomentArc", "Node", "Picture", "Points", "PoseTrack", "bare_picture", "picture_of"]
