"""How far predictions are from measured depth; needs no torch."""
