"""Measurements: each module's `main` prints ratios against a peer or a limit in the same run."""
