"""Noise processes and their sums: theory only, no data. Processes are listed in the order of the imports here."""

from gmwm.theory.processes.noise import WN as WN, QN as QN  # isort: skip
from gmwm.theory.processes.noise import RW as RW  # isort: skip
from gmwm.theory.processes.noise import DR as DR  # isort: skip
from gmwm.theory.processes.markov import AR1 as AR1, GM as GM  # isort: skip
from gmwm.theory.processes.power import FN as FN, PL as PL, FGN as FGN  # isort: skip
from gmwm.theory.processes.matern import MAT as MAT  # isort: skip
from gmwm.theory.processes.oscillator import OSC as OSC  # isort: skip
from gmwm.theory.processes.sinusoid import SIN as SIN  # isort: skip
from gmwm.theory.processes.arma import AR as AR, MA as MA, ARMA as ARMA, SARMA as SARMA  # isort: skip
from gmwm.theory.processes.base import Process, registry
from gmwm.theory.processes.model import Model, ModelLike, as_model
from gmwm.theory.processes.ordered import Ordered, every_class, ordered_classes
from gmwm.theory.processes.parameter import Branch, Fixed, Parameter, Physical, Value, fixed

__all__ = [
    "AR", "AR1", "ARMA", "DR", "FGN", "FN", "GM", "MA", "MAT", "OSC", "PL", "QN", "RW", "SARMA", "SIN", "WN", "Branch",
    "Fixed", "Model", "ModelLike", "Ordered", "Parameter", "Physical", "Process", "Value", "as_model", "every_class",
    "fixed", "ordered_classes", "registry",
]  # fmt: skip
