"""Load a function of an object file into this process, without a linker."""

from typing import Any

import llvmlite.binding as llvm


def load_function(code: bytes, name: str, prototype: Any) -> Any:
    """The function `name` of an object file for this machine, as a ctypes function of type `prototype`."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    linker = llvm.create_lljit_compiler(use_jit_link=True)  # keeps code and constants side by side
    library = llvm.JITLibraryBuilder().add_object_img(code).add_current_process().export_symbol(name)
    linked = library.link(linker, name)
    found = prototype(linked[name])
    found.linked = linked  # keeps the code in memory as long as the function
    return found
