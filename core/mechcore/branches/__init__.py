"""Which branch of the configuration a motion is on: assembly modes, continuation, singular points, unwrapped angles."""
