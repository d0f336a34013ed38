"""WAV files, as sound and vibration recorders write them: samples of a converter, in parts of its full scale."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np

from piezoharvest.readers.base import Reader, ReadError, check_count
from piezoharvest.readers.units import Unit

# Raw value that is full scale, by type: integers as Microsoft's "Multimedia Programming Interface and Data
# Specifications 1.0" (1991) has them; scipy puts the 24 bits of a sample into the upper bits of 32.
_FULL_SCALE = {"u1": 128.0, "i2": 2.0**15, "i4": 2.0**31}
_NOTE = Unit("full scale", "full scale", 1.0)  # converts to no unit of a channel, so that the record has to give a gain
_INCOMPLETE = "not a complete WAV file: it is cut off, or damaged"


def _check_length(path: Path) -> None:
    """Raise `ReadError` if a chunk up to that of the samples is longer than the file: scipy would allocate it."""
    with path.open("rb") as file:
        kind, size = file.read(12)[:4], path.stat().st_size
        name = b"" if kind != b"RF64" else b"data"  # which has lengths of 64 bits elsewhere
        while name != b"data" and len(head := file.read(8)) == 8:
            name, length = head[:4], int.from_bytes(head[4:], "big" if kind == b"RIFX" else "little")
            if file.tell() + length > size:
                raise ReadError(_INCOMPLETE)
            file.seek(length + length % 2, 1)


class Wav(Reader):
    """Channels "channel 1", "channel 2", ... in parts of full scale, -1 to 1; of float samples the values as they are.

    What full scale is in newtons or volts is in no WAV file: a channel's `gain` has to say it.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".wav",)
    magic: ClassVar[tuple[bytes, ...]] = (b"RIFF", b"RIFX", b"RF64")

    def __init__(self, path: Path):
        from scipy.io import wavfile

        super().__init__(path)
        _check_length(path)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", wavfile.WavFileWarning)  # of chunks that hold no samples
                warnings.filterwarnings("error", "Reached EOF prematurely")
                self._rate, samples = wavfile.read(path)
        except MemoryError:
            raise
        except Exception as error:  # scipy raises struct.error, ValueError and others on damaged files
            # Others speak of scipy's own code: a file that is cut off gives an array that cannot be reshaped.
            own = isinstance(error, ValueError | Warning) and "reshape" not in str(error)
            raise ReadError(f"not a complete WAV file ({error})" if own else _INCOMPLETE) from None
        if not self._rate > 0 or samples.dtype.kind not in "uif":
            raise ReadError(f"found {samples.dtype} at {self._rate} Hz, allowed are numbers at a rate above 0 Hz")
        if not samples.size:
            raise ReadError("the file holds no samples, at least one is needed")
        self._samples = samples.reshape(len(samples), -1)
        self.names = tuple(f"channel {n}" for n in range(1, self._samples.shape[1] + 1))

    def read(self, names: Sequence[str]) -> dict[str, np.ndarray]:
        check_count(len(names) * len(self._samples))
        return {name: self._scaled(self._samples[:, self.names.index(name)]) for name in names}

    def unit(self, name: str) -> Unit | None:
        return _NOTE

    def time_of(self, name: str) -> np.ndarray | None:
        return np.arange(len(self._samples)) / self._rate

    def _scaled(self, raw: np.ndarray) -> np.ndarray:
        full = _FULL_SCALE.get(raw.dtype.str[1:], 1.0)
        offset = full if raw.dtype.kind == "u" else 0.0  # 8 bits are counted from 0, with silence at 128
        return (raw.astype(float) - offset) / full
