"""A log of one's own: its frames as arrays, and whether the valve sticks.

python examples/own_log.py bus.log valve.toml
"""

import sys

import numpy as np

from positioner import diagnose, load_log

path, config = sys.argv[1:3]
log = load_log(path, config)
error_m = log.position_m - log.setpoint_m
print(f"{log.frames} frames, {len(log.time_s)} readings in {log.time_s[-1]:.1f} s")
print(f"mean error {1e3 * np.nanmean(np.abs(error_m)):.2f} mm, current {np.nanmin(log.current_ma):.2f} mA and more")

finding = diagnose(path, config)
print(f"sticks: {finding.verdict} ({finding.reason})")
