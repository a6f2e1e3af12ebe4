"""Shape of a free-hanging ply from the poses of the cups that hold it."""
