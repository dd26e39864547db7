"""What Python programs call: a run as arrays, laws and plants that are objects, and errors of one line."""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import positioner
from positioner import PositionerError, diagnose, simulate
from positioner.bench.inprocess import run_in_process
from positioner.bench.scenario import Scenario
from positioner.diagnostics.verdict import Verdict
from positioner.wire.messages import Mode

if TYPE_CHECKING:
    from positioner.laws.law import Observation
    from positioner.laws.registry import Ingredients


class Balance:
    """The current that balances the spring at the setpoint."""

    def __init__(self, parts: Ingredients) -> None:
        self._valve = parts.valve

    def begin(self, measured_m: float) -> None:
        """Remember nothing."""

    def decide(self, memory: None, stem: object, observation: Observation, table: object) -> tuple[None, float]:
        del stem, table
        return memory, self._valve.balance_current_ma(observation.setpoint_m)


class Raising(Balance):
    def decide(self, memory: None, stem: object, observation: Observation, table: object) -> tuple[None, float]:
        del memory, stem, observation, table
        raise RuntimeError("no idea")


def test_a_run_has_the_bits_of_a_bench() -> None:
    run = simulate("paper", "nmpc", (73.0, 87.0), dwell_s=0.2, seed=4)
    scenario = Scenario(
        name="same", title="same", law="nmpc", seed=4, setpoints_mm=(73.0, 87.0), dwell_s=0.2, plant={"preset": "paper"}
    )
    recording = run_in_process(scenario).recording
    for ours, theirs in (
        (run.time_s, recording.time_s),
        (run.position_m, recording.true_position_m),
        (run.measured_m, recording.measured_m),
        (run.setpoint_m, recording.setpoint_m),
        (run.current_ma, recording.current_ma),
        (run.speed_m_per_s, recording.true_velocity_m_per_s),
    ):
        assert ours.shape == (400,)
        np.testing.assert_array_equal(ours, theirs)
    assert [span.mode for span in run.modes] == [Mode.ACTIVE]
    assert [dwell.setpoint_mm for dwell in run.dwells] == pytest.approx([73.0, 87.0])
    assert run.totals.dwells == 2
    assert run.failures == ()
    assert run.table.sequence > 0
    again = simulate("paper", "nmpc", (73.0, 87.0), dwell_s=0.2, seed=4, table=run.table)
    assert again.table.sequence > run.table.sequence


def test_a_class_of_the_notebook_is_a_law_and_its_errors_are_in_the_run() -> None:
    run = simulate(law=Balance, setpoints=(73.0,), dwell_s=0.2)
    assert 1.0 < run.totals.mean_abs_error_pct < 30.0  # the stem sticks far from the setpoint
    assert np.nanmax(np.abs(np.diff(run.current_ma))) < 1e-9
    failed = simulate(law=Raising, setpoints=(73.0,), dwell_s=0.2)
    (text,) = failed.failures
    assert text.startswith("Raising failed: OutsideLawError: RuntimeError: no idea (test_simulate.py, line ")
    assert Mode.ACTIVE not in {span.mode for span in failed.modes[-1:]}


def test_a_plant_may_be_tables_and_setpoints_and_noise_text() -> None:
    stiff = {"preset": "paper", "valve": {"spring_rate_n_per_m": 60000.0}, "sensor": {"noise_of_reading": 0.0}}
    run = simulate(stiff, Balance, "ramp:0.5,from=60,to=70", noise="uniform:0.1%")
    assert run.time_s.shape == (1000,)
    noise_m = run.measured_m - run.position_m
    assert np.std(noise_m) == pytest.approx(0.001 * run.span_m, rel=0.1)
    assert np.max(np.abs(noise_m)) < 0.00174 * run.span_m
    assert run.setpoint_m.max() == pytest.approx(0.07)


def test_a_run_is_diagnosed_by_its_readings() -> None:
    found = diagnose(simulate("paper", "pi", "ramp:5", noise="gaussian:0.05%"))
    assert found.verdict is Verdict.YES
    assert found.stick is not None
    # 2 F_s in percent of 16 mA, with B = S_a K_p
    assert found.stick.value == pytest.approx(100.0 * 2.0 * 1707.7 / (0.06452 * 5171.06775) / 16.0, rel=0.1)
    free = {"valve": {"static_friction_n": 0.0, "coulomb_friction_n": 0.0}}
    smooth = simulate("frictionless", "pi", "ramp:3", noise="gaussian:0.05%", configuration=free)
    assert diagnose(smooth).verdict is not Verdict.YES


@pytest.mark.parametrize(
    ("wrong", "expected"),
    [
        ({"plant": "mars"}, "mars: plant: is unknown; known: ageing"),
        ({"law": "nmcp"}, "is no law; did you mean 'nmpc'?"),
        ({"setpoints": (10.0,)}, "setpoint 10 mm: 4 to 20 mA restart paper both ways from 57.9 to 94.5 mm only"),
        ({"setpoints": ()}, "setpoints_mm = []"),
        ({"setpoints": 73.0}, "setpoints = 73.0: give numbers in mm, such as (73.0, 87.0), or text such as"),
        ({"dwell_s": 0.015}, "must be a whole multiple of setpoint_period_s = 0.01"),
        ({"configuration": {"valv": {}}}, "'valv' is unknown; did you mean 'valve'?"),
        ({"configuration": {"guard": {"current_low": 4.0}}}, "guard.current_low: unknown key"),
        ({"law": int}, "int: law: cannot be made: TypeError"),
        (
            {"configuration": {"control": {"sample_period_s": 0.002}}},
            "control.sample_period_s contradicts period_s=…, which plant and law share: give that",
        ),
        ({"configuration": {"control": {"law": "pi"}}}, "control.law contradicts law=…, which plant and law share"),
    ],
)
def test_a_mistake_is_an_error_of_ours_with_one_line(wrong: dict[str, Any], expected: str) -> None:
    with pytest.raises(PositionerError) as caught:
        simulate(**wrong)
    (line,) = str(caught.value).splitlines()
    assert expected in line


def test_importing_the_package_loads_nothing_and_asking_for_a_name_loads_it() -> None:
    program = """
import sys
before = set(sys.modules)
import positioner
assert set(sys.modules) - before == {"positioner"}, set(sys.modules) - before
assert set(positioner.__all__) <= set(dir(positioner))
positioner.PositionerError
assert "numpy" not in sys.modules
positioner.simulate
assert "numpy" in sys.modules
assert "matplotlib" not in sys.modules
"""
    done = subprocess.run([sys.executable, "-c", program], check=False, capture_output=True, text=True, timeout=900.0)
    assert done.returncode == 0, done.stderr
    with pytest.raises(AttributeError, match="no attribute 'simulat'"):
        positioner.simulat  # type: ignore[attr-defined]  # noqa: B018


def test_a_type_checker_knows_the_names(tmp_path: Any) -> None:
    own = tmp_path / "own.py"
    own.write_text(
        "import positioner\nfrom positioner import diagnose, load_log, simulate\n"
        "reveal_type(simulate().time_s)\nreveal_type(load_log('x').mode)\nreveal_type(diagnose('x').verdict)\n"
        "positioner.simulat\n",
        encoding="utf-8",
    )
    command = [sys.executable, "-m", "mypy", "--no-incremental", "--follow-imports=silent", str(own)]
    done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=900.0)
    assert "numpy.dtype[numpy.floating[numpy._typing._nbit_base._64Bit]]" in done.stdout or "float64" in done.stdout
    assert "Verdict" in done.stdout
    assert 'Module has no attribute "simulat"' in done.stdout
