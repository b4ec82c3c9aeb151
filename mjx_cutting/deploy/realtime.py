"""Asks Linux for what keeps a loop on time: SCHED_FIFO, no idling, locked memory, no garbage collection.

Ordinary scheduling leaves a tail of some 8 ms, because another process may use up its time slice first; FIFO
scheduling takes it away. A processor that sleeps between two deadlines wakes late, on a virtual machine by
milliseconds, since the host has to give it back first; a latency of zero asked of the kernel's power
management (as cyclictest does) keeps it awake while the process lives. All requests need rights (root, or
`ulimit -r`, `ulimit -l`, and access to /dev/cpu_dma_latency); where they are refused the loop runs all the
same, and the answer says so.
"""

from __future__ import annotations

import ctypes
import gc
import os
import resource

_CURRENT, _FUTURE, _ON_FAULT = 1, 2, 4
_LATENCY = "/dev/cpu_dma_latency"
_held: list[int] = []


def request(priority: int | None) -> list[str]:
    """Returns one line for each thing asked for: what was granted, or why not and how to get it.

    Arguments: priority of SCHED_FIFO, 1 to 99; None: ordinary scheduling, memory is locked all the same.

    Raises:
        ValueError: a priority outside 1 to 99.
    """
    told = [] if priority is None else [_fifo(priority), _awake()]
    told.append(_lock())
    gc.collect()
    gc.freeze()
    gc.disable()
    return told


def _fifo(priority: int) -> str:
    if not 1 <= priority <= 99:
        raise ValueError(f"got priority {priority}; expected 1 to 99 (50 is usual)")
    if not hasattr(os, "sched_setscheduler"):
        return "SCHED_FIFO: not on this system; expect a latency tail of some milliseconds"
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except PermissionError:
        most = resource.getrlimit(resource.RLIMIT_RTPRIO)[0]
        return (
            f"SCHED_FIFO {priority}: not permitted (ulimit -r is {most}); expect a latency tail of some "
            "milliseconds; raise rtprio in /etc/security/limits.conf, or run with CAP_SYS_NICE"
        )
    except OSError as error:
        return f"SCHED_FIFO {priority}: refused ({error.strerror}); expect a latency tail of milliseconds"
    return f"SCHED_FIFO {priority}: granted"


def _awake() -> str:
    """Keeps the processors from sleeping for as long as this process lives (the file must stay open)."""
    try:
        file = os.open(_LATENCY, os.O_WRONLY)
        os.write(file, (0).to_bytes(4, "little"))
    except OSError as error:
        return f"idle states: not held off ({_LATENCY}: {error.strerror}); expect late wake-ups"
    _held.append(file)
    return "idle states: held off"


def _lock() -> str:
    try:
        libc = ctypes.CDLL(None, use_errno=True)
        # on fault: only pages in use are locked, so the size of the process stays what it is
        if libc.mlockall(_CURRENT | _FUTURE | _ON_FAULT) == 0:
            return "memory: locked"
        reason = os.strerror(ctypes.get_errno())
    except (OSError, AttributeError) as error:
        reason = str(error)
    return f"memory: not locked ({reason}); raise memlock in /etc/security/limits.conf"
