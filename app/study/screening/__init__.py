"""The tests of acuity and colour vision, the viewing distance, and their verdicts."""
