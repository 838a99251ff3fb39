"""From files of others to runs: raw run folders, vendor listings through a column map, control points."""
