"""Standard output and error of the program: closed, full, or piped into a program that ends early."""

import io
import os
import sys
from typing import TYPE_CHECKING, TextIO

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

STANDARD_ERROR = 2


class Sink(io.FileIO):
    """The file descriptor of a stream; after a failed write, nothing more is written to it."""

    failure: OSError | None = None

    def write(self, data: "ReadableBuffer", /) -> int:
        """Write bytes; an error is kept in `failure` instead of being raised."""
        if self.failure is None:
            try:
                return super().write(data)
            except OSError as error:
                self.failure = error
        return memoryview(data).nbytes


def open_streams() -> Sink:
    """Replace standard output and error by streams that raise no error; returns the sink of the output.

    Closed descriptors become the null device: otherwise the next opened file would take their number.
    """
    while (descriptor := os.open(os.devnull, os.O_RDWR)) <= STANDARD_ERROR:
        pass
    os.close(descriptor)
    output, error = Sink(1, "w", closefd=False), Sink(STANDARD_ERROR, "w", closefd=False)
    sys.stdout = text_on(output, sys.stdout, by_line=output.isatty())
    sys.stderr = text_on(error, sys.stderr, by_line=True)
    return output


def text_on(sink: Sink, before: TextIO | None, by_line: bool) -> TextIO:
    """A text stream in the encoding of the replaced stream; characters outside the encoding become '?'."""
    encoding = "utf-8" if before is None else before.encoding
    return io.TextIOWrapper(io.BufferedWriter(sink), encoding, "replace", line_buffering=by_line)
