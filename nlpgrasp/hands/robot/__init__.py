"""A robot as plain data: links, joints and shapes, from whichever file they are read."""
