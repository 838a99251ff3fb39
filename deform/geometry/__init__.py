"""Pure mathematics: the earth, rotations, resampling, curvature, circles; arrays in, arrays out."""
