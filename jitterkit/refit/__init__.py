"""The refit: from starting values to parameters, errors and a status.

Reach for :func:`fit_best_locus` first; :func:`fit_locus` fits a locus of your choice, and
:func:`fit_frame` is what both call.  What is known beforehand goes into :class:`Priors`.
"""

from jitterkit.refit.choose import fit_best_locus, single_star
from jitterkit.refit.choose_scene import SCENES, choose_scene
from jitterkit.refit.fit import FitOptions, fit_frame
from jitterkit.refit.locus_fit import fit_locus
from jitterkit.refit.posterior import Posterior
from jitterkit.refit.prior_file import KernelPrior, read_kernel_prior
from jitterkit.refit.priors import Priors, kernel_prior, moments_prior, sequence_prior, trace_prior
from jitterkit.refit.result import Candidate, FitResult, Status
from jitterkit.refit.sampling import sample_posterior
from jitterkit.refit.scene_choice import SceneChoice
