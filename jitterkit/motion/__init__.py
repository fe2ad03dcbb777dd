"""Motion of the pointing: from a spectrum or a record to what an exposure sees of it, and back."""

from jitterkit.motion.assessment import Assessment, assess_motion, predicted_locus, smeared_locus
from jitterkit.motion.budget import Share, critical_frequency, motion_budget, regime, smooth_locus
from jitterkit.motion.files import read_motion
from jitterkit.motion.loop import close_loop, follow, loop_rejection
from jitterkit.motion.record import Exposures, Record, measure_exposures, trace_spectrum
from jitterkit.motion.simulation import simulate_exposures, simulate_pointing
from jitterkit.motion.spectrum import Line, PowerSpectrum
from jitterkit.motion.split import (
    PARTS,
    Split,
    cumulative_split,
    difference_weight,
    legendre_weight,
    motion_between_frames,
    part_weights,
    split_line,
    split_spectrum,
)
