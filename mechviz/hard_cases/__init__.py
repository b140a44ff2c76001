"""Hard cases: places where mechanisms are hard, with what is expected there."""
