"""The decoder under a fuzzer that follows its branches (atheris): it refuses what the oracle refuses, and nothing else.

Start it as `python -m endurance.fuzz_decoder -runs=3000000`; `make fuzz` does. Its options are those of libFuzzer.
"""

from __future__ import annotations

import sys

try:
    import atheris
except ImportError:
    version = f"{sys.version_info.major}.{sys.version_info.minor}"
    sys.stderr.write(
        f"fuzz: atheris is not installed for Python {version} (pip install atheris; it has no wheel for all)\n"
    )
    raise SystemExit(1) from None

with atheris.instrument_imports(include=["positioner.wire"]):
    from positioner.wire.codec import make_codec
    from positioner.wire.formats import FrameRejectedError
    from positioner.wire.messages import CanFrame

from endurance.oracle import KINDS, verdict_of
from positioner.wire import e2e

CODEC = make_codec()
IDENTIFIERS = (*KINDS, 0x7FF)
HEAD = 2
FLAGS = {"is_error": 1, "is_remote": 2, "is_extended": 4}
MEND_CRC = 8


def check(data: bytes) -> None:
    """Give the frame in `data` to decoder and oracle: its identifier, its flags, its bytes.

    Raises:
        AssertionError: they differ.
    """
    if len(data) < HEAD:
        return
    identifier, flags, body = IDENTIFIERS[data[0] % len(IDENTIFIERS)], data[1], data[HEAD:]
    if flags & MEND_CRC and len(body) > HEAD and identifier in KINDS:
        body = e2e.protect(body, KINDS[identifier].data_id)
    frame = CanFrame(identifier, body, **{name: bool(flags & bit) for name, bit in FLAGS.items()})
    try:
        CODEC.decode(frame)
        verdict = "good"
    except FrameRejectedError as error:
        verdict = error.counted.text if error.counted is not None else "unknown identifier"
    if verdict != verdict_of(frame):
        raise AssertionError(f"{frame}: the decoder says '{verdict}', the oracle '{verdict_of(frame)}'")


def main() -> None:
    """Fuzz until the runs of the command line are done; libFuzzer ends the process itself."""
    atheris.Setup([*sys.argv, "-seed=1", "-max_len=20", "-print_final_stats=1"], check)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
