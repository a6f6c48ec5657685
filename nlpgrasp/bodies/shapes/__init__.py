"""Surfaces of bodies as triangles, made from what defines them: their vertices are on the body itself."""
