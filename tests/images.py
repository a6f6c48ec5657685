"""What a picture file holds."""

from itertools import pairwise

import numpy as np
from matplotlib import image


def colours(path):
    """Return a picture's pixels, (height, width, 3), each channel from 0 to 1."""
    return image.imread(path)[..., :3]


def size(path):
    """Return width and height in pixels."""
    height, width = colours(path).shape[:2]
    return width, height


def panels_drawn(path, columns):
    """Return the share of pixels unlike the background in each of some columns of equal width."""
    pixels = colours(path)
    drawn = np.any(np.abs(pixels - pixels[0, 0]) > 0.02, axis=-1)
    edges = np.linspace(0, drawn.shape[1], columns + 1).astype(int)
    return [float(drawn[:, a:b].mean()) for a, b in pairwise(edges)]
