"""Fit many frames together: shared parameters once, a frame's own parameters frame by frame.

Reach for :func:`refit_sequence`.
"""

from jitterkit.joint.combine import Combined, Shared, combine
from jitterkit.joint.frame_fitter import FrameFitter
from jitterkit.joint.likelihood_summary import LikelihoodSummaries, LikelihoodSummary
from jitterkit.joint.ornstein_uhlenbeck import fit_ornstein_uhlenbeck
from jitterkit.joint.records import Exposure, FrameRecord, Records
from jitterkit.joint.refit import SequenceOptions, refit_sequence
from jitterkit.joint.result import Rows, SequenceFit, SequenceFrame, Slope
from jitterkit.joint.time_models import Constant, OrnsteinUhlenbeck, Polynomial, TimeModel, parse_time_model
from jitterkit.joint.velocity import velocity_between_frames, velocity_from_trace
