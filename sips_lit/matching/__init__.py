"""Which point of one image belongs to which of the other, by their descriptors."""
