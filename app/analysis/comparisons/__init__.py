"""Compare conditions: one comparison, factors, groups, homogeneity, the rows of results, and power."""
