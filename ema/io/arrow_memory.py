"""Content that Arrow's own threads may let go of at any time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import pyarrow as pa


def arrow_reader(content: bytes) -> pa.BufferReader:
    """Copy bytes to memory of Arrow's own, for it to read.

    When parsing fails, a thread of Arrow's may be the last to let go of what it read. Were that
    Python's, the thread would have to ask the interpreter; asking while Python ends, it would be
    stopped by force, and with it the process: exit code 134 instead of the error's.

    Parameters
    ----------
    content : bytes

    Returns
    -------
    pyarrow.BufferReader
    """
    import pyarrow as pa

    # The default pool holds megabytes in reserve.
    memory = pa.allocate_buffer(len(content), memory_pool=pa.system_memory_pool())
    np.frombuffer(memory, np.uint8)[:] = np.frombuffer(content, np.uint8)
    return pa.BufferReader(memory)
