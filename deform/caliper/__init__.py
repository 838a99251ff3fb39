"""The wall and the joints: cross-sections, ovality, dents, tool pose and the weld log from the arms (`measure`)."""
