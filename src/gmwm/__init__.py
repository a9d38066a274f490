"""Stochastic calibration of inertial sensors by the Generalized Method of Wavelet Moments.

Conventions, stated once. Everything inside is SI: rad/s and m/s² for signals, s for times, Hz for rates.
Parameters of processes are per sample (a white noise variance σ² is that of one sample), except the inverse
correlation time β of a Gauss-Markov process, which is in 1/s. Levels count from 1; the scale of level j is
τ_j = 2^j samples. The Allan variance at the averaging time τ_j / 2 is twice the Haar wavelet variance ν_j².
"""

from gmwm.calibration import Agreement as Agreement
from gmwm.calibration import Calibration as Calibration
from gmwm.calibration import agreement as agreement
from gmwm.calibration import calibrate as calibrate
from gmwm.continuous_statespace import ContinuousStateSpace as ContinuousStateSpace
from gmwm.covariance import wavelet_covariance as wavelet_covariance
from gmwm.covariance.empirical import empirical_covariance as empirical_covariance
from gmwm.datasheets import Datasheet as Datasheet
from gmwm.datasheets import datasheet as datasheet
from gmwm.datasheets import effective_noise as effective_noise
from gmwm.errors import DataError as DataError
from gmwm.errors import FitWarning as FitWarning
from gmwm.errors import GmwmError as GmwmError
from gmwm.errors import GmwmWarning as GmwmWarning
from gmwm.errors import InferredUnitWarning as InferredUnitWarning
from gmwm.errors import MissingDependencyError as MissingDependencyError
from gmwm.errors import MissingTheoryError as MissingTheoryError
from gmwm.errors import ModelError as ModelError
from gmwm.errors import OptionError as OptionError
from gmwm.errors import ReadError as ReadError
from gmwm.errors import TimeBaseWarning as TimeBaseWarning
from gmwm.errors import UnitError as UnitError
from gmwm.estimation import Fit as Fit
from gmwm.estimation import Sampled as Sampled
from gmwm.estimation import Start as Start
from gmwm.estimation import fit as fit
from gmwm.exporters import export as export
from gmwm.exporters import export_formats as export_formats
from gmwm.filters import WaveletFilter as WaveletFilter
from gmwm.filters import find_filter as find_filter
from gmwm.fleets import Fleet as Fleet
from gmwm.fleets import fleet as fleet
from gmwm.inference.planning import Plan as Plan
from gmwm.inference.planning import plan as plan
from gmwm.inspection import Inspection as Inspection
from gmwm.inspection import inspect as inspect
from gmwm.likelihood import LikelihoodFit as LikelihoodFit
from gmwm.likelihood import Residuals as Residuals
from gmwm.likelihood import Tracks as Tracks
from gmwm.likelihood import fit_ml as fit_ml
from gmwm.likelihood import loglikelihood as loglikelihood
from gmwm.outliers import Verdict as Verdict
from gmwm.outliers import contamination as contamination
from gmwm.plots import compare as compare
from gmwm.plots import plot_imu as plot_imu
from gmwm.processes import AR as AR
from gmwm.processes import AR1 as AR1
from gmwm.processes import ARMA as ARMA
from gmwm.processes import DR as DR
from gmwm.processes import FGN as FGN
from gmwm.processes import FN as FN
from gmwm.processes import GM as GM
from gmwm.processes import MA as MA
from gmwm.processes import MAT as MAT
from gmwm.processes import PL as PL
from gmwm.processes import QN as QN
from gmwm.processes import RW as RW
from gmwm.processes import SARMA as SARMA
from gmwm.processes import SIN as SIN
from gmwm.processes import WN as WN
from gmwm.processes import Model as Model
from gmwm.processes import Process as Process
from gmwm.processes import fixed as fixed
from gmwm.processes import parse_model as parse_model
from gmwm.readers import read as read
from gmwm.readers import stream as stream
from gmwm.reports import report as report
from gmwm.reports import report_data as report_data
from gmwm.selection import Candidate as Candidate
from gmwm.selection import Ranking as Ranking
from gmwm.selection import rank as rank
from gmwm.selection import select as select
from gmwm.signals import Imu as Imu
from gmwm.signals import Signal as Signal
from gmwm.simulation import SimulatedImu as SimulatedImu
from gmwm.simulation import SimulatedSignal as SimulatedSignal
from gmwm.simulation import reference_imu as reference_imu
from gmwm.simulation import simulate as simulate
from gmwm.simulation import simulate_signal as simulate_signal
from gmwm.simulation import write_components as write_components
from gmwm.statespace import StateSpace as StateSpace
from gmwm.variance import AllanRegression as AllanRegression
from gmwm.variance import ClusterVariance as ClusterVariance
from gmwm.variance import WaveletAccumulator as WaveletAccumulator
from gmwm.variance import WaveletVariance as WaveletVariance
from gmwm.variance import allan_variance as allan_variance
from gmwm.variance import avlr as avlr
from gmwm.variance import dwt as dwt
from gmwm.variance import hadamard_variance as hadamard_variance
from gmwm.variance import modwt as modwt
from gmwm.variance import total_variance as total_variance
from gmwm.variance import wavelet_variance as wavelet_variance
from gmwm.writers import write as write

__version__ = "0.1.0"
