"""Change between runs at the same steel: stack, datum, differences with sigma, zones, dents, joints, trends."""
