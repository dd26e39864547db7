"""Offer the metrics of a positioner (`[metrics] file`) over OPC UA: Objects/FV-101/position_meters = 0.062.

pip install asyncua
python opcua_bridge.py /var/lib/prometheus/node-exporter/positioner.prom opc.tcp://127.0.0.1:4840
"""

import asyncio
import contextlib
import re
import sys
from pathlib import Path

from asyncua import Server

SAMPLE = re.compile(r'^positioner_(\w+)\{valve="([^"]*)"(?:,\w+="([^"]*)")?\} (\S+)$', re.MULTILINE)


async def main(path: str, endpoint: str) -> None:
    """Serve until Ctrl-C."""
    server, nodes = Server(), {}
    await server.init()
    server.set_endpoint(endpoint)
    space = await server.register_namespace("sticking-valve-positioner")
    async with server:
        while True:
            text = ""
            with contextlib.suppress(FileNotFoundError):  # no positioner runs
                text = await asyncio.to_thread(Path(path).read_text, "utf-8")
            for name, valve, part, number in SAMPLE.findall(text):
                key = f"{name}.{part}" if part else name
                if valve not in nodes:
                    nodes[valve] = await server.nodes.objects.add_folder(space, valve)
                if (valve, key) not in nodes:
                    nodes[valve, key] = await nodes[valve].add_variable(space, key, 0.0)
                await nodes[valve, key].write_value(float(number))
            await asyncio.sleep(5.0)


if __name__ == "__main__":
    asyncio.run(main(*sys.argv[1:]))
