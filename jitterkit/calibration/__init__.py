"""Calibration: what bias, dark and flat frames say about a detector.

    stacks = open_stacks("bias", ["bias/"])[0], open_stacks("dark", ["dark/"]), open_stacks("flat", ["flat/"])
    calibration = calibrate(*stacks)
    calibration.gain, calibration.read_noise.number, calibration.dark_current.values

:func:`calibrate` does all of it: masters without cosmic rays (:func:`combine`), dark current, response, bad
pixels, and photon transfer (:func:`photon_transfer`): gain, full well and linearity from how the variance
rises with the light.  :func:`write_calibration` leaves maps and an instrument file for the other commands.
"""

from jitterkit.calibration.calibration import FLAGS, Calibration, Settings, calibrate
from jitterkit.calibration.level import Level
from jitterkit.calibration.linearity import Linearity, fit_linearity
from jitterkit.calibration.master import Master, MeasuredMap, combine
from jitterkit.calibration.products import together, write_calibration
from jitterkit.calibration.stack import Shot, Stack
from jitterkit.calibration.stack_files import open_stacks
from jitterkit.calibration.transfer import PhotonTransfer, photon_transfer
