"""Prediction of a record, whatever circuit it is behind."""

from __future__ import annotations

from typing import TypeAlias

from piezoharvest.predict.circuit.circuit_prediction import CircuitPrediction
from piezoharvest.predict.prediction import Prediction

AnyPrediction: TypeAlias = Prediction | CircuitPrediction
