"""Bodies of links: masses that follow from shapes."""
