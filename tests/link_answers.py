"""Answers of `ip -details -statistics -json link show` from iproute2 6.1: one interface in each, all of them in `ALL`.

The answers for virtual interfaces are recorded. Those for controllers follow iproute2's source (ip/iplink_can.c);
5.x prints sample points as numbers, 6.x as strings.
"""

from __future__ import annotations

import json
from typing import Any


def stats(over_errors: int = 0) -> dict[str, Any]:
    received = {"bytes": 800, "packets": 100, "errors": 0, "dropped": 0, "over_errors": over_errors, "multicast": 0}
    sent = {"bytes": 800, "packets": 100, "errors": 0, "dropped": 0, "carrier_errors": 0, "collisions": 0}
    return {"rx": received, "tx": sent}


VCAN0 = (
    '[{"ifindex":2,"ifname":"vcan0","flags":["NOARP","UP","LOWER_UP"],"mtu":72,"qdisc":"noqueue","operstate":"UNKNOWN",'
    '"linkmode":"DEFAULT","group":"default","txqlen":1000,"link_type":"can","promiscuity":0,"allmulti":0,"min_mtu":0,'
    '"max_mtu":0,"linkinfo":{"info_kind":"vcan"},"num_tx_queues":1,"gso_max_size":65536,"gso_max_segs":65535,'
    '"tso_max_size":65536,"tso_max_segs":65535,"gro_max_size":65536,"stats64":{"rx":{"bytes":0,"packets":0,"errors":0,'
    '"dropped":0,"over_errors":0,"multicast":0},"tx":{"bytes":0,"packets":0,"errors":0,"dropped":0,"carrier_errors":0,'
    '"collisions":0}}}]'
)
VXCAN_DOWN = (
    '[{"ifindex":4,"link":"vx0","ifname":"vx1","flags":["NOARP","M-DOWN"],"mtu":72,"qdisc":"noop","operstate":"DOWN",'
    '"linkmode":"DEFAULT","group":"default","txqlen":1000,"link_type":"can","promiscuity":0,"allmulti":0,"min_mtu":0,'
    '"max_mtu":0,"linkinfo":{"info_kind":"vxcan"},"num_tx_queues":1,"gso_max_size":65536,"gso_max_segs":65535}]'
)
LOOPBACK = (
    '[{"ifindex":1,"ifname":"lo","flags":["LOOPBACK","UP","LOWER_UP"],"mtu":65536,"qdisc":"noqueue","operstate":'
    '"UNKNOWN","linkmode":"DEFAULT","group":"default","txqlen":1000,"link_type":"loopback","address":'
    '"00:00:00:00:00:00","broadcast":"00:00:00:00:00:00","promiscuity":0,"allmulti":0,"num_tx_queues":1}]'
)
MCP251X = (  # a SPI controller at 500 kbit/s, as its driver and `ip link set` leave it
    '[{"ifindex":3,"ifname":"can0","flags":["NOARP","UP","LOWER_UP","ECHO"],"mtu":16,"qdisc":"pfifo_fast","operstate":'
    '"UP","linkmode":"DEFAULT","group":"default","txqlen":10,"link_type":"can","promiscuity":0,"allmulti":0,"min_mtu":0,'
    '"max_mtu":0,"linkinfo":{"info_kind":"can","info_data":{"state":"ERROR-ACTIVE","restart_ms":0,"bittiming":{'
    '"bitrate":500000,"sample_point":"0.875","tq":250,"prop_seg":3,"phase_seg1":3,"phase_seg2":1,"sjw":1,"brp":1},'
    '"bittiming_const":{"name":"mcp251x","tseg1":{"min":3,"max":16},"tseg2":{"min":2,"max":8},"sjw":{"min":1,"max":4},'
    '"brp":{"min":1,"max":64},"brp_inc":1},"clock":8000000},"info_xstats":{"restarts":0,"bus_error":0,'
    '"arbitration_lost":0,"error_warning":0,"error_passive":0,"bus_off":0}},"num_tx_queues":1,"gso_max_size":65536,'
    '"gso_max_segs":65535,"parentbus":"spi","parentdev":"spi0.0","stats64":{"rx":{"bytes":0,"packets":0,"errors":0,'
    '"dropped":0,"over_errors":0,"multicast":0},"tx":{"bytes":0,"packets":0,"errors":0,"dropped":0,"carrier_errors":0,'
    '"collisions":0}}}]'
)
PEAK_USB = (  # a USB adapter at 1 Mbit/s with restart-ms 100 and error counters
    '[{"ifindex":5,"ifname":"can1","flags":["NOARP","UP","LOWER_UP","ECHO"],"mtu":16,"qdisc":"pfifo_fast","operstate":'
    '"UP","linkmode":"DEFAULT","group":"default","txqlen":128,"link_type":"can","promiscuity":0,"allmulti":0,"min_mtu":0,'
    '"max_mtu":0,"linkinfo":{"info_kind":"can","info_data":{"ctrlmode":["BERR-REPORTING"],"state":"ERROR-ACTIVE",'
    '"berr_counter":{"tx":0,"rx":1},"restart_ms":100,"bittiming":{"bitrate":1000000,"sample_point":0.750,"tq":125,'
    '"prop_seg":2,"phase_seg1":3,"phase_seg2":2,"sjw":1},"bittiming_const":{"name":"pcan_usb","tseg1":{"min":1,'
    '"max":16},"tseg2":{"min":1,"max":8},"sjw":{"min":1,"max":4},"brp":{"min":1,"max":64},"brp_inc":1},'
    '"clock":8000000},"info_xstats":{"restarts":0,"bus_error":0,"arbitration_lost":0,"error_warning":0,'
    '"error_passive":0,"bus_off":0}},"num_tx_queues":1,"parentbus":"usb","parentdev":"1-1.2:1.0","stats64":{"rx":{'
    '"bytes":8,"packets":1,"errors":0,"dropped":0,"over_errors":0,"multicast":0},"tx":{"bytes":8,"packets":1,"errors":0,'
    '"dropped":0,"carrier_errors":0,"collisions":0}}}]'
)
ALL = json.dumps([entry for one in (LOOPBACK, VCAN0, VXCAN_DOWN, MCP251X, PEAK_USB) for entry in json.loads(one)])


def changed(answer: str, *, over_errors: int = 0, totals: dict[str, int] | None = None, **data: Any) -> str:
    """Return the answer with other values in its `info_data`, its `info_xstats` and its statistics."""
    (entry,) = json.loads(answer)
    entry["linkinfo"]["info_data"].update(data)
    entry["linkinfo"].setdefault("info_xstats", {}).update(totals or {})
    entry["stats64"] = stats(over_errors)
    return json.dumps([entry])


def down(answer: str) -> str:
    """Return the answer for an interface that is down."""
    (entry,) = json.loads(answer)
    entry["flags"], entry["operstate"] = ["NOARP", "ECHO"], "DOWN"
    if "info_data" in entry["linkinfo"]:
        entry["linkinfo"]["info_data"]["state"] = "STOPPED"
    return json.dumps([entry])
