"""Frames that are in a run twice, recognised by their pixels whatever their files are called."""

from __future__ import annotations


class Duplicates:
    """Remembers the frames of a run by the digests of their pixels."""

    def __init__(self) -> None:
        self._names: dict[str, str] = {}

    def original(self, digest: str, name: str) -> str:
        """Find the frame of which a frame is a duplicate.

        Parameters
        ----------
        digest : str
            ``RawFrame.digest`` of the frame; empty if it is not known, and then the frame is no duplicate.
        name : str
            Name of the frame, to be returned for its duplicates.

        Returns
        -------
        name : str
            Of the first frame with these pixels; empty if this is the first.
        """
        first = self._names.get(digest, "")
        if digest and not first:
            self._names[digest] = name
        return first
