"""Frames whose truth is known, and the truth as header cards."""

from jitterkit.simulate.cards import fits_header, tiff_metadata, truth_cards
from jitterkit.simulate.checks import check_inside, check_reach, check_scene, read_stars
from jitterkit.simulate.frames import Simulated, simulate_frame, simulate_sequence
