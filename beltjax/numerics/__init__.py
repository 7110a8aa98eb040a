"""Mathematics that knows no belts, usable on its own."""
