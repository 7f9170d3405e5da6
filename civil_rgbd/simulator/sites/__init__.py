"""Five bridges of different construction, drawn in metres, with everything about them."""
