"""Requests to valgrind's callgrind from inside the process that it runs: count from here, count to here.

A request is a sequence of instructions that does nothing on a processor and that valgrind knows (valgrind.h). It is
written down here for x86-64, so that nothing has to be compiled.
"""

from __future__ import annotations

import ctypes
import mmap
import platform

_REQUEST = bytes.fromhex(
    "4889f8"  # mov rax, rdi: the request and its arguments
    "31d2"  # xor edx, edx: the answer where there is no valgrind
    "48c1c703 48c1c70d 48c1c73d 48c1c733"  # rol rdi by 3, 13, 61 and 51: by 128 in all
    "4887db"  # xchg rbx, rbx
    "4889d0 c3"  # mov rax, rdx; ret
)
_RUNNING_ON_VALGRIND = 0x1001
_ZERO_STATS, _DUMP_STATS_AT, _START_INSTRUMENTATION = 0x43540001, 0x43540003, 0x43540004

Arguments = ctypes.c_ulong * 6


class Callgrind:
    """The counter of the valgrind that runs this process.

    Raises:
        RuntimeError: no valgrind runs it.
    """

    def __init__(self) -> None:
        if platform.machine() != "x86_64":
            raise RuntimeError("the requests to valgrind are written for x86-64 only")
        self._memory = mmap.mmap(-1, mmap.PAGESIZE, prot=mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC)
        self._memory.write(_REQUEST)
        kind = ctypes.CFUNCTYPE(ctypes.c_ulong, ctypes.POINTER(Arguments))
        self._request = kind(ctypes.addressof(ctypes.c_char.from_buffer(self._memory)))
        if not self._request(Arguments(_RUNNING_ON_VALGRIND)):
            raise RuntimeError("no valgrind runs this process")
        self._zero = Arguments(_ZERO_STATS)

    def start(self) -> None:
        """Begin to count: until now the process has run without counters, and so faster."""
        self._request(Arguments(_START_INSTRUMENTATION))

    def zero(self) -> None:
        """Forget what was counted."""
        self._request(self._zero)

    def dump(self, label: bytes) -> None:
        """Write what was counted since `zero` into a file of its own, with `label` in its line `Trigger`."""
        text = ctypes.create_string_buffer(label)
        self._request(Arguments(_DUMP_STATS_AT, ctypes.addressof(text)))
