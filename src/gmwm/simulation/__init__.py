"""Using: recordings and signals whose truth is known, with the latent processes that they are sums of."""

from gmwm.simulation.api import models_by_axis as models_by_axis
from gmwm.simulation.api import simulate as simulate
from gmwm.simulation.api import simulate_signal as simulate_signal
from gmwm.simulation.components import SimulatedImu as SimulatedImu
from gmwm.simulation.components import SimulatedSignal as SimulatedSignal
from gmwm.simulation.components import write_components as write_components
from gmwm.simulation.reference import reference_imu as reference_imu
