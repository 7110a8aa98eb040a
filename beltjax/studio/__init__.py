"""A page to design on: what is dragged, what answers, and the server that shows it."""
