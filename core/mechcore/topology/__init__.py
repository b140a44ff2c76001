"""The graph of a mechanism, the order in which its groups are solved, and checks before it is compiled."""
