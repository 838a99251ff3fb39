"""Multi-epoch deformation analysis of pipelines."""
