"""Trains depth models, in plain torch; needs the extra ``train``."""
