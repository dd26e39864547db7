"""A log of one's own: its frames as arrays, and whether the valve sticks.

python examples/own_log.py bus.log valve.toml
"""

import sys

from positioner import diagnose, load_log

path, config = sys.argv[1:3]
log = load_log(path, config, complete=True)  # from the first setpoint and the first command on
error_m = abs(log.position_m - log.setpoint_m)
print(f"{log.frames} frames, {len(log.time_s)} readings until {log.time_s[-1]:.1f} s")
print(f"mean error {1e3 * error_m.mean():.2f} mm, current {log.current_ma.min():.2f} mA and more")

finding = diagnose(path, config)
print(f"sticks: {finding.verdict} ({finding.reason})")
