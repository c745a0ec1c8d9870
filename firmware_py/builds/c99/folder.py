"""The folder with the firmware in C: source, headers, the example for a board, and how to compile it."""

from firmware_py.builds.a2l import a2l
from firmware_py.builds.c99.emitter import Emitter
from firmware_py.builds.c99.header import TEMPLATES, config_header, header
from firmware_py.core.config import Config
from firmware_py.interface.addresses import Addresses
from firmware_py.node.memory import file_name

OPTIONS = ("-std=c99", "-O2", "-ffp-contract=off", "-fno-math-errno")
"""The compiler's options that keep the bits, for gcc and clang."""
CPUS = {
    "cortex_m7": ("-mcpu=cortex-m7", "-mfpu=fpv5-d16", "-mfloat-abi=hard"),
    "cortex_m4f": ("-mcpu=cortex-m4", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard"),
}
"""The compiler's options for the processors."""


def folder_of_c(emitter: Emitter, config: Config, addresses: Addresses) -> dict[str, str]:
    """The texts of the files by their names, the source first."""
    readme = TEMPLATES.get_template("README.md.j2").render(
        precision=emitter.precision,
        has_gait=emitter.has_gait,
        a2l=f"{file_name()}.a2l",
        options=" ".join(OPTIONS),
        **{name: " ".join(options) for name, options in CPUS.items()},
    )
    return {
        "vibro_firmware.c": emitter.text(),
        "vibro_firmware.h": header(emitter.precision),
        "vibro_config.h": config_header(config, emitter.precision),
        f"{file_name()}.a2l": a2l(addresses),
        "README.md": readme,
    }
