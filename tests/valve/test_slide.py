"""A slide in samples: the same motion as that of the motion model."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from positioner.valve.motion import Load, MotionModel
from positioner.valve.parameters import ValveParameters
from positioner.valve.slide import slide_of

MODEL = MotionModel.of(ValveParameters(id="preloaded", bench_set_n=200.0))
CRITICAL_N_S_PER_M = 2.0 * math.sqrt(52538.0 * MODEL.mass_kg)
loads = st.builds(
    Load,
    st.sampled_from([52538.0, 42000.0]),
    st.floats(0.0, 1700.0),
    st.sampled_from([1.0, 100.0, 612.9, 9000.0, CRITICAL_N_S_PER_M]),
)
signs = st.sampled_from([1.0, -1.0])
places_m = st.floats(0.0, 0.14)
speeds_m_per_s = st.one_of(st.sampled_from([0.0, -0.0, -0.1, 1e-9]), st.floats(1e-3, 2.0))
currents_ma = st.floats(4.0, 20.0)


@settings(max_examples=300)
@given(loads, signs, places_m, speeds_m_per_s, currents_ma, st.sampled_from([1e-4, 1e-3, 5e-3, 3e-2, 0.2]))
def test_a_sample_ends_where_the_motion_model_ends(
    load: Load, s: float, x: float, speed: float, current_ma: float, period_s: float
) -> None:
    slide = slide_of(MODEL, load, s, period_s)
    end = MODEL.step(x, s * speed, current_ma, load, s, period_s)
    assert slide.after(x, s * speed, current_ma) == pytest.approx((end.x, end.v), abs=1e-12)


@given(loads, signs, st.sampled_from([1e-4, 1e-3]))
def test_the_constants_of_a_sample_are_the_derivatives_of_the_motion_model(
    load: Load, s: float, period_s: float
) -> None:
    slide = slide_of(MODEL, load, s, period_s)
    driving_ma = MODEL.current_ma(load.spring_n_per_m * 0.08 + s * (load.friction_n + 2.0 * load.viscous_n_s_per_m))
    end = MODEL.step(0.08, s * 1.5, driving_ma, load, s, period_s)
    assert not end.stopped
    assert (slide.x_x, slide.x_v, slide.v_x, slide.v_v) == (end.dx_dx, end.dx_dv, end.dv_dx, end.dv_dv)
    more, less = (MODEL.step(0.08, s * 1.5, driving_ma + step_ma, load, s, period_s) for step_ma in (0.01, -0.01))
    by_ma = ((more.x - less.x) / 0.02, (more.v - less.v) / 0.02)  # the motion is linear in the current
    assert (slide.x_ma, slide.v_ma) == pytest.approx(by_ma, rel=1e-6)
