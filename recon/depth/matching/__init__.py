"""The steps that the matchers are built of: census, guide, hierarchy, aggregation, the search of planes."""
