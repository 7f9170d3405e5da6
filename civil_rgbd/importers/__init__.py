"""Sets of RGB-D frames that others rendered, taken over as bridge folders."""
