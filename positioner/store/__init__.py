"""The persistent stiction table. Shell.

One state directory is one valve:

    stiction.sqlite         the table, written in transactions by one process only, the table writer
    stiction.good.sqlite    a complete copy, used when the table is found damaged
    stiction.<reason>-<UTC time>-<n>.sqlite   tables that were found but not used: moved aside, never deleted
    backups/                what a reset or an import replaced, as `positioner table import` reads it
    control.sock            how `positioner table` reaches the table writer while the daemon runs

Whoever uses the directory holds an flock on the directory itself.

The way of a sample: daemon → `client.TableWriterClient.record` → socket pair → `writer` (a child process) →
`table_directory` → `database` (the file). The daemon's cycle waits for none of it.
"""
