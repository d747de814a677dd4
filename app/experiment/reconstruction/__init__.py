"""The paper's experiment up to its stimulus set: recordings, models, videos and measures.

Every step keeps what it made (`Artefacts`), so a second start makes only what is missing. `app.experiment` goes on from
the manifest and `objective.json`.
"""

from app.experiment.reconstruction.folder import Experiment
from app.experiment.reconstruction.plan import steps
from app.experiment.reconstruction.scale import SCALES, Scale

__all__ = ["SCALES", "Experiment", "Scale", "steps"]
