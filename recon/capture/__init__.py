"""From a recording to rectified pictures: read and write captures, and rectify their sensors' pairs.

Importers are in `recon.capture.importing`, calibration in `recon.capture.calibration`, the checker in
`recon.capture.checking`, foreground masks in `recon.capture.masks`.
"""

from recon.capture.format import read_capture, read_frame, read_held_out, read_masks, write_capture
from recon.capture.images import CaptureError
from recon.capture.recording import CameraStream, Capture, HeldOut, SensorStream
from recon.capture.rectify import Rectification, rectify, rectify_images, rectify_masks

__all__ = [
    "CameraStream",
    "Capture",
    "CaptureError",
    "HeldOut",
    "Rectification",
    "SensorStream",
    "read_capture",
    "read_frame",
    "read_held_out",
    "read_masks",
    "rectify",
    "rectify_images",
    "rectify_masks",
    "write_capture",
]
