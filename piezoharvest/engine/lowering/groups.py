"""Configurations of a shunt by groups that differ in numbers only, each of which is asked for its equations once."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from piezoharvest.description.shunts.base import Shunt, each_of
from piezoharvest.engine.lowering.layout import joined


class Groups:
    """Groups of the configurations of a shunt.

    Attributes
    ----------
    names : tuple of str
        A name for each group, by which the shunt knows it.
    index : dict of str to int
        Places of all configurations.
    places : list of (members,) int array
        Those of each group.
    """

    def __init__(self, shunt: Shunt) -> None:
        self.names = shunt.alike()
        self.index = {name: c for c, name in enumerate(shunt.configurations())}
        self._found: dict[str, np.ndarray] = {}
        self.places = [self.targets(name) for name in self.names]

    def targets(self, name: str) -> np.ndarray:
        """Places of the configurations that a name stands for."""
        if name not in self._found:
            self._found[name] = np.array([self.index[each] for each in each_of(name)])
        return self._found[name]

    def spread(self, blocks: Sequence[np.ndarray], rank: int) -> np.ndarray:
        """Blocks of all configurations, along an axis before the last `rank` ones.

        Parameters
        ----------
        blocks : sequence of array
            Of each group, with `rank` axes behind those of a batch. Shorter ones are padded by zeros along the first of
            these. Those of a group whose members differ have an axis for them before that of a batch.
        rank : int
        """
        lengths = {block.shape[-rank] for block in blocks}
        if len(self.names) == len(self.index) and len(lengths) == 1 and 0 not in lengths:
            return joined(blocks, -rank - 1)
        own = [_behind_batch(block, rank) for block in blocks]
        batch = np.broadcast_shapes(*{block.shape[: -rank - 1] for block in own})
        shape = (*batch, len(self.index), max(1, *lengths), *blocks[0].shape[1 - rank :][: rank - 1])
        out = np.zeros(shape, np.result_type(*{block.dtype for block in own}))
        for places, block in zip(self.places, own, strict=True):
            out[(..., places, slice(block.shape[-rank]), *[slice(None)] * (rank - 1))] = block
        return out

    def integers(self, items: Sequence[Sequence[Any]], read: Callable[[Any], Any]) -> np.ndarray:
        """Whole numbers of the items of every configuration, -1 where there are fewer; of a group one, or an array."""
        table = np.full((len(self.index), max(1, *map(len, items))), -1)
        for places, own in zip(self.places, items, strict=True):
            if own:  # of one number for all members, or one for each
                table[places, : len(own)] = np.array([read(item) for item in own]).reshape(len(own), -1).T
        return table

    def each(self, values: Iterable[Any]) -> list[Any]:
        """Values of all configurations, from those of the groups."""
        found: list[Any] = [None] * len(self.index)
        for places, value in zip(self.places, values, strict=True):
            for c in places:
                found[c] = value
        return found


def _behind_batch(block: np.ndarray, rank: int) -> np.ndarray:
    """A block with the axis of a group's members, which may be missing, behind that of a batch."""
    if block.ndim < rank + 2:
        return np.expand_dims(block, -rank - 1)
    block = np.moveaxis(block, 0, -rank - 1)
    return block[0] if len(block) == 1 else block  # no batch
