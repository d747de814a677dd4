"""Objective evaluation, beside the way from capture to video: it may use any stage, none uses it."""
