"""Stars of a frame, each in a stamp of its own: the record in which the modules of a star field meet."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage


@dataclass(frozen=True, eq=False)
class Stars:
    """Isolated stars of one frame, each in a stamp of its own.

    Attributes
    ----------
    x, y : (n,) array
        Centres in the frame, pixels; centroids, good to a tenth.
    electrons : (n, s, s) array
        Background subtracted; s is odd, and the stamp's middle pixel the one nearest to the centre.
    sky_variance : (n, s, s) array
        Of sky and read-out [electrons²]; a star's own photon noise comes on top.
    response : (n, s, s) array
        What the electrons were divided by, as in :class:`~jitterkit.frames.frame.Frame`.
    used : (n, s, s) bool array
        False for pixels that are bad, beyond the frame or part of another star.
    frame_shape : (int, int)
        ``(ny, nx)`` of the frame.
    """

    x: np.ndarray
    y: np.ndarray
    electrons: np.ndarray
    sky_variance: np.ndarray
    response: np.ndarray
    used: np.ndarray
    frame_shape: tuple[int, int]

    def __len__(self) -> int:
        return len(self.x)

    @property
    def middle(self) -> np.ndarray:
        """Return the middle pixel ``(n, 2)`` of each stamp, columns x and y."""
        return np.stack([np.rint(self.x), np.rint(self.y)], axis=1).astype(int)

    @property
    def variance(self) -> np.ndarray:
        """Return the variance of ``electrons`` (n, s, s); of pixels not used without photon noise."""
        return self.sky_variance + np.where(self.used, np.clip(self.electrons, 0, None), 0.0) / self.response

    def chosen(self, which: np.ndarray) -> Stars:
        """Some of the stars, by index or boolean array."""
        arrays = {name: value[which] for name, value in vars(self).items() if name != "frame_shape"}
        return replace(self, **arrays)


def cut_out(image, variance, response, bad, labels, x, y, own, half: int) -> Stars:
    """Stamps about stars; what lies beyond the frame is not used."""
    shape = image.shape
    image, variance = (np.pad(a, half) for a in (image, variance))
    bad, response = np.pad(bad, half, constant_values=True), np.pad(response, half, constant_values=1.0)
    labels = np.pad(labels, half)
    grid = np.arange(2 * half + 1)
    rows = np.rint(y).astype(int)[:, None, None] + grid[:, None]
    columns = np.rint(x).astype(int)[:, None, None] + grid
    stamps = labels[rows, columns]
    others = (stamps > 0) & (stamps != own[:, None, None])
    others = ndimage.binary_dilation(others, np.ones((1, 3, 3), bool), iterations=2)
    used = ~bad[rows, columns] & ~others
    image, variance, response = (a[rows, columns] for a in (image, variance, response))
    return Stars(x, y, image, variance, response, used, shape)


def stand_alone(stars: Stars, radius: float) -> np.ndarray:
    """Return which stars have every pixel within a radius [pixels]."""
    half = stars.used.shape[-1] // 2
    grid = np.arange(-half, half + 1)
    core = np.hypot(*np.meshgrid(grid, grid)) < max(radius, 2.0)
    return np.all(stars.used | ~core, axis=(1, 2))
