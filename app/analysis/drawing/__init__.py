"""What all charts share: their look, their files, and the code that draws them elsewhere."""
