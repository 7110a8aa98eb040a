"""Many designs: which ones, their answers in batches, and the store that holds them."""
