"""Foreground masks: what of each picture belongs to the object."""

from recon.capture.masks.segment import segment_capture

__all__ = ["segment_capture"]
