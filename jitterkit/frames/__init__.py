"""Frames in and out: FITS, TIFF and arrays, with where every number about them came from.

``read_frames(path)`` gives :class:`RawFrame` after :class:`RawFrame`; ``open_frames(path)`` the file
they are in.  A detector makes a :class:`Frame` of one, and ``jitterkit.frames.region.find_region``
cuts the stars out of a full camera frame first.  Importing this package loads no format library.
"""

from jitterkit.frames.files import find_files
from jitterkit.frames.frame import Frame, RawFrame
from jitterkit.frames.framefile import FrameFile
from jitterkit.frames.header import resolve_header
from jitterkit.frames.metadata import Metadata, Sourced
from jitterkit.frames.reader import frame_count, is_whole, open_frames, read_frames
from jitterkit.frames.sky import sky_position_angle
from jitterkit.frames.writer import write_fits, write_tiff
