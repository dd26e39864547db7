"""A log of the bus: which current acted on which reading, and `positioner diagnose` on it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import can
import numpy as np
import pytest
from numpy.typing import NDArray

from positioner.cli.main import main
from positioner.config.reader import load_config
from positioner.replay.log import LogError
from positioner.replay.stem_log import stem_table
from positioner.wire.messages import CurrentCommand, Quality, StemPosition

if TYPE_CHECKING:
    from positioner.wire.codec import Codec

Array = NDArray[np.float64]
ROOT = Path(__file__).resolve().parents[2]
CONFIG = ROOT / "tests/logs/nmpc.toml"
STATIC_N, SLIDING_N = 1707.7, 1423.0
SPRING_N_PER_M, GAIN_N_PER_MA, SPAN_M = 52538.0, 333.637, 0.127


def stick_slip(current_ma: Array) -> Array:
    """Return the stem in m of the paper's valve without mass: it rests while |B·u - K·x| ≤ F_s."""
    place_m, found = GAIN_N_PER_MA * current_ma[0] / SPRING_N_PER_M, []
    for each in current_ma.tolist():
        pull_n = GAIN_N_PER_MA * each - SPRING_N_PER_M * place_m
        if abs(pull_n) > STATIC_N:
            place_m = (GAIN_N_PER_MA * each - np.sign(pull_n) * SLIDING_N) / SPRING_N_PER_M
        found.append(place_m)
    return np.array(found)


def write_log(path: Path, codec: Codec, current_ma: Array, position_m: Array, faulty: frozenset[int]) -> None:
    """Write a command and then the reading that it acted on for each sample; a faulty reading is far off."""
    with can.CanutilsLogWriter(path) as log:
        for number, (current, place) in enumerate(zip(current_ma.tolist(), position_m.tolist(), strict=True)):
            quality = Quality.FAULT if number in faulty else Quality.VALID
            reading = StemPosition(0.0 if number in faulty else place, number % 256, quality)
            for frame in (codec.encode(CurrentCommand(current), number), codec.encode(reading, number)):
                log.on_message_received(
                    can.Message(
                        timestamp=1e-3 * number,
                        arbitration_id=frame.arbitration_id,
                        data=frame.data,
                        is_extended_id=frame.is_extended,
                    )
                )


@pytest.fixture(scope="module")
def swinging(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Array, Array]:
    """Return the log of a slow swing of the paper's valve, noise 0.05 % of span, and its current and readings."""
    time = np.arange(12000)
    current_ma = 12.0 + 5.5 * np.sin(time / 500.0) + 1.5 * np.sin(time / 210.0)
    noise_m = 0.0005 * SPAN_M * np.random.default_rng(3).standard_normal(time.size)
    position_m = stick_slip(current_ma) + noise_m
    path = tmp_path_factory.mktemp("log") / "bus.log"
    write_log(path, load_config(CONFIG).make_codec(), current_ma, position_m, frozenset({500, 501}))
    return path, current_ma, position_m


def test_every_valid_reading_comes_with_the_current_that_acted_on_it(swinging: tuple[Path, Array, Array]) -> None:
    path, current_ma, position_m = swinging
    table = stem_table(path, load_config(CONFIG))
    kept = np.delete(np.arange(current_ma.size), [500, 501])
    assert table.stem is not None
    assert np.abs(table.op - current_ma[kept]).max() <= 0.001
    assert np.abs(table.stem - 100.0 * position_m[kept] / SPAN_M).max() <= 0.01
    assert table.slope == pytest.approx(SPRING_N_PER_M * SPAN_M / (16.0 * GAIN_N_PER_MA), rel=1e-4)


def test_stick_and_jump_of_the_papers_valve(
    swinging: tuple[Path, Array, Array], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """S = (F_s + F_c)/(16 mA·B) = 58.65 %, J = (F_s - F_c)/(16 mA·B) = 5.33 %."""
    picture = tmp_path / "stem.png"
    arguments = ["diagnose", str(swinging[0]), "--config", str(CONFIG), "--json", "--picture", str(picture)]
    assert main(arguments) == 1
    found = json.loads(capsys.readouterr().out)
    assert (found["verdict"], found["method"], found["indirect"]) == ("yes", "direct", None)
    assert found["stick_percent"]["value"] == pytest.approx(58.65, rel=0.02)
    assert found["jump_percent"]["value"] == pytest.approx(5.33, abs=0.3)
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_a_log_without_the_valve_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "other.log"
    with can.CanutilsLogWriter(path) as log:
        log.on_message_received(can.Message(timestamp=0.0, arbitration_id=0x7AB, data=b"\1\2"))
    with pytest.raises(LogError, match=r"holds 1 frames, and no stem position under a command of bench among them"):
        stem_table(path, load_config(CONFIG))


def test_a_log_without_its_configuration_is_told_what_is_missing(
    swinging: tuple[Path, Array, Array], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["diagnose", str(swinging[0])]) == 74
    assert "A bus log needs --config" in capsys.readouterr().err
