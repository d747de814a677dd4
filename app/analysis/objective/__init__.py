"""Compare objective measures with the scores: how well each predicts them, how sure that is, which predicts best."""
