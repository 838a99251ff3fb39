"""The noun of the house: one passage of one tool, raw (`raw`) or on its chainage (`build`, `schema`, `store`, `history`)."""
