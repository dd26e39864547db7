"""The persistent stiction table, and the health of the valve. Shell.

One state directory is one valve:

    stiction.sqlite         the table, written in transactions by one process only, the table writer
    stiction.good.sqlite    a complete copy, used when the table is found damaged
    stiction.<reason>-<UTC time>-<n>.sqlite   tables that were found and not used: moved aside, never deleted
    health.json             the health of the valve (`health_file`)
    backups/                what a reset or an import replaced; `positioner table import` reads the tables
    control.sock            how `positioner table` reaches the table writer while the daemon runs

Every process that writes in the directory holds an flock on the directory itself.

A sample goes this way: daemon → `client.TableWriterClient.record` → socket pair → `writer` (a child process) →
`table_directory` → `database` (the file). The daemon's cycle waits for none of it.
"""
