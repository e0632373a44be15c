"""Laws that no file of the catalogue lists: families of a few numbers that a law can be learned from."""
