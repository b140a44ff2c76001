"""A second executor: the steps of a mechanism's programs written out as straight-line C, compiled and loaded at run time."""
