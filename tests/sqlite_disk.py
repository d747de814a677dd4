"""What SQLite has written to the disk and what it has waited for: a power cut to order, and a slow disk.

A shim around SQLite's own file functions, put in by ctypes. It notes after each sync how far the write-ahead log is
safe; a power cut may take everything beyond, and `cut_power` does. Only for Pythons that share SQLite's library.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import mmap
from collections.abc import Callable
from pathlib import Path
from typing import Any

OPEN_WAL = 0x00080000  # SQLITE_OPEN_WAL
N_METHODS = 18  # of version 3 of sqlite3_io_methods, after its version number
WRITE, TRUNCATE, SYNC = 3, 4, 5  # their places in it, counted from 0 for iVersion
SAFE_BYTES = 8

_FILE = ctypes.c_void_p
_WRITE = ctypes.CFUNCTYPE(ctypes.c_int, _FILE, ctypes.c_void_p, ctypes.c_int, ctypes.c_int64)
_SYNC = ctypes.CFUNCTYPE(ctypes.c_int, _FILE, ctypes.c_int)
_OPEN = ctypes.CFUNCTYPE(
    ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p, _FILE, ctypes.c_int, ctypes.POINTER(ctypes.c_int)
)
_kept: list[Any] = []  # SQLite keeps pointers to these


class _Vfs(ctypes.Structure):
    """The beginning of sqlite3_vfs, up to xOpen; the rest is copied as it is."""

    _fields_ = (
        ("version", ctypes.c_int),
        ("file_size", ctypes.c_int),
        ("longest_path", ctypes.c_int),
        ("next", ctypes.c_void_p),
        ("name", ctypes.c_char_p),
        ("app_data", ctypes.c_void_p),
        ("open", ctypes.c_void_p),
        ("rest", ctypes.c_void_p * 15),
    )


class Log:
    """How far the write-ahead log reaches, and how much of it is safe."""

    def __init__(self, note: Callable[[int], None]) -> None:
        self.end = 0
        self.note = note

    def write(self, offset: int, length: int) -> None:
        if offset == 0:  # it begins anew: what it held is in the database, which was synced
            self.end = 0
            self.note(0)
        self.end = max(self.end, offset + length)

    def sync(self) -> None:
        self.note(self.end)


def install(state: Path | None, pause: Callable[[], object] = lambda: None) -> None:
    """Watch the write-ahead log of every database that this process opens from now on.

    Parameters
    ----------
    state : file that holds how many bytes of the log are safe; it outlives the process
    pause : called in each sync; what is slow here is a slow disk
    """
    log = Log(_noting(state) if state else lambda _end: None)
    library = ctypes.CDLL(ctypes.util.find_library("sqlite3"))
    library.sqlite3_vfs_find.restype = ctypes.POINTER(_Vfs)
    original = library.sqlite3_vfs_find(None)
    shim = _Vfs.from_buffer_copy(original.contents)
    shim.name = b"watched"
    shim.next = None
    open_original = _OPEN(original.contents.open)
    methods: dict[int, Any] = {}

    def open_file(_vfs: Any, name: Any, file: Any, flags: int, out_flags: Any) -> int:
        result = int(open_original(ctypes.addressof(original.contents), name, file, flags, out_flags))
        if result == 0 and flags & OPEN_WAL:
            pointer = ctypes.cast(file, ctypes.POINTER(ctypes.c_void_p))
            table = pointer[0]
            if table not in methods:
                methods[table] = _watched(table, log, pause)
            pointer[0] = ctypes.addressof(methods[table])
        return result

    callback = _OPEN(open_file)
    shim.open = ctypes.cast(callback, ctypes.c_void_p).value
    _kept.extend([callback, shim, methods, open_original, original, log])
    if library.sqlite3_vfs_register(ctypes.byref(shim), 1) != 0:
        raise RuntimeError("SQLite does not take the shim")


def is_possible() -> bool:
    """Whether Python's SQLite is the shared library that ctypes finds."""
    import sqlite3

    name = ctypes.util.find_library("sqlite3")
    if name is None:
        return False
    library = ctypes.CDLL(name)
    library.sqlite3_libversion.restype = ctypes.c_char_p
    return (
        library.sqlite3_libversion().decode() == sqlite3.sqlite_version and name in Path("/proc/self/maps").read_text()
    )


def cut_power(database: Path, state: Path) -> int:
    """Take from the log of a dead process what had not been synced; how many bytes that was."""
    safe = int.from_bytes(state.read_bytes(), "little")
    log = database.with_name(database.name + "-wal")
    lost = log.stat().st_size - safe
    with log.open("r+b") as file:
        file.truncate(safe)
    database.with_name(database.name + "-shm").unlink(missing_ok=True)
    return lost


def _noting(state: Path) -> Callable[[int], None]:
    state.write_bytes(bytes(SAFE_BYTES))
    with state.open("r+b") as file:
        shared = mmap.mmap(file.fileno(), SAFE_BYTES)

    def note(end: int) -> None:
        shared[:] = end.to_bytes(len(shared), "little")

    return note


def _watched(methods: int, log: Log, pause: Callable[[], object]) -> Any:
    """A copy of a table of file functions that tells the log what is written and synced."""
    table = (ctypes.c_void_p * (N_METHODS + 1)).from_buffer_copy(
        (ctypes.c_void_p * (N_METHODS + 1)).from_address(methods)
    )
    write_original, sync_original = _WRITE(table[WRITE] or 0), _SYNC(table[SYNC] or 0)

    def write(file: Any, content: Any, length: int, offset: int) -> int:
        log.write(offset, length)
        return int(write_original(file, content, length, offset))

    def sync(file: Any, flags: int) -> int:
        result = int(sync_original(file, flags))
        pause()
        log.sync()
        return result

    callbacks = _WRITE(write), _SYNC(sync)
    table[WRITE], table[SYNC] = (ctypes.cast(callback, ctypes.c_void_p).value for callback in callbacks)
    _kept.extend([callbacks, write_original, sync_original])
    return table
