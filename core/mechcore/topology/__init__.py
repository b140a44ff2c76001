"""The graph of a mechanism, the order in which its groups are solved, and what must hold before it is compiled."""
