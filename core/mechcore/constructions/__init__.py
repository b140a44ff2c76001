"""Graphical constructions from the solver's own numbers: vector polygons, centrodes, equivalent linkages, the funicular polygon."""
