"""From direction and wall shape to strain: bending from curvature, dents from their shape, axial strain from joint lengths."""
