"""A plant out of an FMU (FMI 2.0, co-simulation): `--plant examples/fmu_plant.py:valve` (docs/own-plant.md)."""

import shutil
import tempfile
import weakref
from pathlib import Path

from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave


class Instance:
    """An FMU while it runs, and its time; the FMU has the state."""

    def __init__(self, plant):
        """Start it; the plant keeps its files."""
        self.plant, self.time_s, self.runs, description = plant, 0.0, False, plant.description
        identifier = description.coSimulation.modelIdentifier
        self.slave = FMU2Slave(guid=description.guid, unzipDirectory=plant.folder, modelIdentifier=identifier)
        self.slave.instantiate()
        self.slave.setupExperiment(startTime=0.0)
        self.slave.enterInitializationMode()
        self.slave.exitInitializationMode()
        self.runs = True

    def __del__(self):
        """End it."""
        if self.runs:
            self.slave.terminate()
            self.slave.freeInstance()


class FmuPlant:
    """The plant: names of the FMU's variables for the current in mA, position in m, velocity in m/s and the reading."""

    def __init__(self, file, tables, current, position, velocity, reading=None):
        """Unpack the FMU into a folder that is deleted with this object."""
        self.folder, self.tables = tempfile.mkdtemp(), tables
        weakref.finalize(self, shutil.rmtree, self.folder, ignore_errors=True)
        self.description = read_model_description(extract(file, self.folder))
        references = {each.name: each.valueReference for each in self.description.modelVariables}
        self.current, self.place = [references[current]], [references[position], references[velocity]]
        self.shown = [references[reading or position]]

    def begin(self, seed):
        """Return an instance of the FMU."""
        return Instance(self)

    def advance(self, state, current_ma, seconds):
        """Let the FMU take one step."""
        state.slave.setReal(self.current, [current_ma])
        state.slave.doStep(currentCommunicationPoint=state.time_s, communicationStepSize=seconds)
        state.time_s += seconds
        return state

    def reading(self, state):
        """Return what the sensor shows, in m."""
        return state.slave.getReal(self.shown)[0]

    def truth(self, state):
        """Return the position in m and the velocity in m/s."""
        return state.slave.getReal(self.place)


TOLD = {  # what a positioner is told of it
    "valve": {"initial_position_m": 0.05},
    "actuator": {"fill_time_constant_s": 0.03, "vent_time_constant_s": 0.03},
}


def valve():
    """Return the plant of the FMU beside this file."""
    file = str(Path(__file__).with_name("valve.fmu"))
    return FmuPlant(file, TOLD, "current_ma", "position_m", "velocity_m_per_s")
