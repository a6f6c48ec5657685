"""Branch and bound over clusters of a mesh, with mixtures that all nodes share."""
