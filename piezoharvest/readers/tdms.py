"""TDMS files of LabVIEW and other NI software."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from piezoharvest.readers.base import Reader, ReadError, check_count, numbers


class Tdms(Reader):
    """TDMS file: channels by "group/channel", or by the channel's name alone; scaled as their properties say."""

    suffixes: ClassVar[tuple[str, ...]] = (".tdms",)
    magic: ClassVar[tuple[bytes, ...]] = (b"TDSm", b"TDSh")
    unsafe: ClassVar[tuple[str, ...]] = ("nptdms",)
    extra: ClassVar[str] = "tdms"

    def __init__(self, path: Path):
        from nptdms import TdmsFile
        from nptdms.log import log_manager

        super().__init__(path)
        log_manager.set_level(logging.ERROR)  # its warnings are errors below
        try:
            self._file = TdmsFile.open(path)
            incomplete = self._file.file_status.incomplete_final_segment
        except Exception as error:  # nptdms raises any exception on damaged files
            raise ReadError(f"not a complete TDMS file ({error})") from None
        if incomplete:
            raise ReadError("the file is incomplete: its last segment is cut off")
        self._channels: dict[str, Any] = {
            f"{group.name}/{channel.name}": channel for group in self._file.groups() for channel in group.channels()
        }
        self.names = tuple(self._channels)

    def read(self, names: Sequence[str]) -> dict[str, np.ndarray]:
        check_count(sum(len(self._channels[name]) for name in names))
        return {name: self._column(name) for name in names}

    def _column(self, name: str) -> np.ndarray:
        try:
            values = self._channels[name][:]
        except MemoryError:
            raise
        except Exception as error:  # as above
            raise ReadError(f"the file is damaged ({error})", name) from None
        return numbers(values, name)

    def time_of(self, name: str) -> np.ndarray | None:
        """Time from the channel's waveform properties, if it has them."""
        channel = self._channels[name]
        step = channel.properties.get("wf_increment", 0.0)
        return channel.properties.get("wf_start_offset", 0.0) + step * np.arange(len(channel)) if step else None

    def close(self) -> None:
        self._file.close()
