"""The kinds of loads: each with its keyword, its keys, the names that it refers to, an example, and what it is in the core."""
