"""From measured trials to the physical effect a force model lacks, and the error before and after."""

from mjx_cutting.tracing.along.predicted import predict_trials
from mjx_cutting.tracing.fitting.prediction import Prediction
from mjx_cutting.tracing.told import Tracing
from mjx_cutting.tracing.trace import save, trace

__all__ = ["Prediction", "Tracing", "predict_trials", "save", "trace"]
