"""Many frames fitted together: what they share once, what is a frame's own frame by frame.

Reach for :func:`refit_sequence`.
"""

from jitterkit.joint.combine import Combined, Shared, combine
from jitterkit.joint.laws import Constant, Law, Polynomial, Wander, parse_law
from jitterkit.joint.look import Looker
from jitterkit.joint.message import Message, Messages
from jitterkit.joint.records import FrameRecord, Records
from jitterkit.joint.refit import Exposure, SequenceOptions, refit_sequence
from jitterkit.joint.result import Rows, SequenceFit, SequenceFrame, Slope
from jitterkit.joint.velocity import velocity_between_frames, velocity_from_trace
from jitterkit.joint.wander import measure_wander

__all__ = [
    "Combined",
    "Constant",
    "Exposure",
    "FrameRecord",
    "Law",
    "Looker",
    "Message",
    "Messages",
    "Polynomial",
    "Records",
    "Rows",
    "SequenceFit",
    "SequenceFrame",
    "SequenceOptions",
    "Shared",
    "Slope",
    "Wander",
    "combine",
    "measure_wander",
    "parse_law",
    "refit_sequence",
    "velocity_between_frames",
    "velocity_from_trace",
]
