"""Lines with known truth: options in, raw run folders and their truth out."""
