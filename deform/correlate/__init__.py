"""Runs meet weld by weld: identities of welds and joints through all runs, chainage maps, similarity to control points."""

from deform.correlate.weld_matching import Matching, match_runs

__all__ = ["Matching", "match_runs"]
