"""From counts to the centreline: alignment, odometer, filter and smoother, trajectory."""
