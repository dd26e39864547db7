"""Publish the metrics of a positioner (`[metrics] file`) over MQTT: positioner/FV-101/position_meters = 0.062.

pip install paho-mqtt
python mqtt_bridge.py /var/lib/prometheus/node-exporter/positioner.prom broker.example
"""

import re
import sys
import time
from pathlib import Path

import paho.mqtt.client as mqtt

SAMPLE = re.compile(r'^positioner_(\w+)\{valve="([^"]*)"(?:,\w+="([^"]*)")?\} (\S+)$', re.MULTILINE)


def topics(path: str) -> dict[str, str]:
    """Return each metric of each valve: its topic, and its number as text."""
    try:
        found = SAMPLE.findall(Path(path).read_text("utf-8"))
    except FileNotFoundError:  # no positioner runs
        found = []
    return {"/".join(filter(None, ("positioner", valve, name, part))): number for name, valve, part, number in found}


def main(path: str, broker: str) -> None:
    """Publish until Ctrl-C."""
    client, sent = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2), set()
    client.connect(broker)
    client.loop_start()
    while True:
        found = topics(path).items()
        for topic, number in found - sent:
            client.publish(topic, number, retain=True)
        sent = set(found)
        time.sleep(5.0)


if __name__ == "__main__":
    main(*sys.argv[1:])
