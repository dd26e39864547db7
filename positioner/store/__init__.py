"""The persistent stiction table. Shell.

One state directory is one valve:

    stiction.sqlite         the table, written in transactions by one process only, the table writer
    stiction.good.sqlite    a complete copy, used when the table is found damaged
    stiction.<reason>-<UTC time>-<n>.sqlite   tables that were found and not used: moved aside, never deleted
    backups/                tables that a reset or an import replaced; `positioner table import` reads them
    control.sock            how `positioner table` reaches the table writer while the daemon runs

Every process that writes in the directory holds an flock on the directory itself.

A sample goes this way: daemon → `client.TableWriterClient.record` → socket pair → `writer` (a child process) →
`table_directory` → `database` (the file). The daemon's cycle waits for none of it.
"""
