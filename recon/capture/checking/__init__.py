"""Everything that is wrong with a capture, in one go."""

from recon.capture.checking.check import CheckReport, check_capture

__all__ = ["CheckReport", "check_capture"]
